"""The command line `novelty`."""

from novelty.cli.app import main

__all__ = ["main"]
