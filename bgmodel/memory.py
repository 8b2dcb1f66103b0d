"""What a run needs of memory, said before it starts."""

from __future__ import annotations


def check_memory(needed_bytes: float, what: str) -> None:
    """Raise ValueError, before anything is run, if there is not so much memory.

    Parameters
    ----------
    needed_bytes : float
        An estimate.
    what : str
        What needs it, for the message.
    """
    # Importing it takes a moment: only where something large may come.
    import psutil

    free = psutil.virtual_memory().available
    if needed_bytes > free:
        raise ValueError(f"{what} need {_size(needed_bytes)} of memory, {_size(free)} are free")


def check_learning_memory(runs: int, episodes: int) -> None:
    """Raise ValueError if there is no memory for what learning keeps of each run and episode."""
    check_memory(10 * 8 * float(runs) * episodes, f"{runs} runs of {episodes} episodes")


def _size(count: float) -> str:
    for unit in ("bytes", "kB", "MB", "GB", "TB"):
        if count < 1000:
            return f"{count:.3g} {unit}"
        count /= 1000
    return f"{count:.3g} PB"
