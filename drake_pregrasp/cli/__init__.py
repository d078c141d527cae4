"""The command line."""

from drake_pregrasp.cli.command import main

__all__ = ["main"]
