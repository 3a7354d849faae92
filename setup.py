"""Adds two folders of the repository to the installed package; the rest is in pyproject.toml."""

from setuptools import find_packages, setup

# name inside the wheel -> folder here; rona_ui/resources.py finds them in both places
FOLDERS = {"rona_ui._static": "static", "rona_ui._sessions": "sessions"}

setup(
    packages=[*find_packages(include=["rona_core*", "rona_ui*"]), *FOLDERS],
    package_dir=FOLDERS,
    package_data={
        "rona_core": [
            "py.typed",
            "virtual/specimen/simulated/head_template.*",
            "app/overview/studied_beds/*.json",
        ],
        "rona_ui._static": ["**/*"],
        "rona_ui._sessions": ["demo.rona", "README.md"],
    },
)
