"""Kinds of damage to a file, for tests of what reads files."""

from functools import partial


def doubled(x):
    """Return twice a number: a function for Numba, whose file imports little."""
    return x + x


def flipped(content, share):
    """Return bytes of which one, at a share of the length, has another bit."""
    at = min(int(share * len(content)), len(content) - 1)
    return content[:at] + bytes([content[at] ^ 1 << int(share * 997) % 8]) + content[at + 1 :]


DAMAGES = {
    "empty": lambda content: b"",
    "halved": lambda content: content[: len(content) // 2],
    "text": lambda content: b"no such file",
    **{f"flipped at {share}": partial(flipped, share=share) for share in (0, 0.1, 0.5, 0.9, 1)},
}
