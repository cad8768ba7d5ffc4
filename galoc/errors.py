"""The one exception galoc raises on bad input, and its one warning."""

from __future__ import annotations


class GalocError(ValueError):
    """Bad input, explained: what was given, what was expected and how to mend it.

    Args:
        got: what the caller gave, in words (include the name of the argument or file).
        expected: what would have been accepted, with its unit.
        cure: what to do about it, as an imperative sentence.

    Made from another one alone, it is its copy: that is how Gymnasium raises a worker's error in the parent process.
    """

    def __init__(self, got: str | GalocError, expected: str = "", cure: str = "") -> None:
        parts = (got.got, got.expected, got.cure) if isinstance(got, GalocError) else (got, expected, cure)
        self.got: str = parts[0]
        self.expected: str = parts[1]
        self.cure: str = parts[2]
        super().__init__(f"got {self.got}; expected {self.expected}. {self.cure}")

    def __reduce__(self) -> tuple[type[GalocError], tuple[str, str, str]]:
        """Pickle by the three parts, so that the error crosses process borders."""
        return (type(self), (self.got, self.expected, self.cure))


class CacheWarning(UserWarning):
    """The cache on disk is damaged or cannot be written; results are right, only computed anew."""
