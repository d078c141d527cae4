"""Former place of `one_line`."""

from drake_pregrasp.errors import one_line as in_words

__all__ = ["in_words"]
