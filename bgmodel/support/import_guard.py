"""The check that the package ``circuits`` is the one that comes with bgmodel."""

from __future__ import annotations


def explained(error: ImportError) -> ImportError:
    """Return an error of import, in plain words if another package called ``circuits`` caused it.

    The name also belongs to another distribution, which may have been installed over ours.
    """
    if not (error.name or "").startswith("circuits"):
        return error
    return ImportError(
        "the package 'circuits' that was found is not bgmodel's: another distribution of that "
        "name is installed beside it; use an environment of its own"
    )
