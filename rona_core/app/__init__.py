"""The application: steps, and what runs them. Importing it declares the steps, in each process."""

from rona_core.app.overview.exports import STEP as STEP
from rona_core.app.steps import STEPS as STEPS
