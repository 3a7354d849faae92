"""What is shown: view, snapshot and what follows from them. Panels and scene draw it."""
