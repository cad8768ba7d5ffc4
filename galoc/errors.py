"""The one exception galoc raises on bad input, and its one warning."""

from __future__ import annotations


class GalocError(ValueError):
    """Bad input, explained: what was given, what was expected and how to mend it.

    Args:
        got: what the caller gave, in words (include the name of the argument or file).
        expected: what would have been accepted, with its unit.
        cure: what to do about it, as an imperative sentence.
    """

    def __init__(self, got: str, expected: str, cure: str) -> None:
        self.got = got
        self.expected = expected
        self.cure = cure
        super().__init__(f"got {got}; expected {expected}. {cure}")

    def __reduce__(self) -> tuple[type[GalocError], tuple[str, str, str]]:
        """Pickle by the three parts, so that the error crosses process borders."""
        return (type(self), (self.got, self.expected, self.cure))


class CacheWarning(UserWarning):
    """The cache on disk is damaged or cannot be written; results are right, only computed anew."""
