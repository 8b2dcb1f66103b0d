"""Commands that show: the whole chain on one page, the interactive explorer, and the figures."""

from __future__ import annotations

import os
import sys
import threading
import webbrowser
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

from bgmodel.commands.options import OFF, Workers
from bgmodel.commands.output import Files, check_whole, say
from bgmodel.support.files import remove_partial_files
from bgmodel.support.processes import run_snakemake
from bgmodel.tactile.recordings import find_recordings
from circuits.errors import require


def demo(*, seed: int = 1, plot: Path = Path("demo.png"), force: bool = False) -> None:
    """Decide on shipped taps by spikes and by the optimal test, and let reward set the threshold.

    Example: bgmodel demo

    Parameters
    ----------
    seed
        Seed of the evidence and of the noise of cells.
    plot
        File for the picture, .png, .pdf or .svg.
    force
        Overwrite an existing picture.
    """
    output = Files(plot=plot, force=force)
    output.check(())
    say("decisions of some 120 000 spiking cells")
    from bgmodel import demo as whole

    chain = whole.demo(seed)
    print(chain.summary())
    output.draw(lambda: whole.draw(chain))


def explore(file: str = "", /, *, port: int = 5006, browser: Annotated[bool, OFF] = True) -> None:
    """Open a circuit in the browser: edit it, and watch its spikes, decisions and behaviour.

    The page is served to this machine only, at an address that contains a secret; Ctrl-C ends it.

    Examples: bgmodel explore; bgmodel explore mine.toml; bgmodel explore stn_conflict --port 0

    Parameters
    ----------
    file
        A circuit or an included experiment by name, a .toml file of either, or a link from the
        explorer; by default the macaque circuit.
    port
        Port of the page; 0 for any that is free.
    browser
        Whether to open the page in the browser.
    """
    if find_spec("panel") is None:
        raise ImportError('the explorer needs Panel: pip install "bgmodel[explore]"')
    from bgmodel.explorer.state import opened

    state = opened(file)
    state.check()
    from bgmodel.explorer.server import Served

    served = Served(state, port)
    print(f"bgmodel explorer: {served.address}", flush=True)
    print("It is for this machine only; Ctrl-C ends it.", file=sys.stderr, flush=True)

    def show() -> None:
        if not webbrowser.open(served.address):
            say("no browser was found: open the address above")

    if browser:
        threading.Thread(target=show, daemon=True).start()
    served.run()


LOCKS = Path(".snakemake/locks")
"""Where Snakemake locks the files of a run; a killed run leaves its locks behind."""


def _check_unlocked() -> None:
    """Raise ValueError if Snakemake has locked the folder."""
    if LOCKS.is_dir() and any(LOCKS.iterdir()):
        raise ValueError(
            "another run is drawing figures in this checkout, or was killed: wait for its end, or, "
            "if it is gone, remove its lock with `bgmodel figures --unlock`"
        )


def figures(
    *targets: str,
    fast: bool = False,
    recordings: Path | None = None,
    unlock: bool = False,
    workers: Workers = 2,
) -> None:
    """Draw every figure that is not drawn yet, from a checkout of the project.

    Example: bgmodel figures --fast

    Parameters
    ----------
    targets
        Names of figures, such as fig4a, or files to make; all by default.
    fast
        A coarse run with few trials, into figures/fast.
    recordings
        Folder of real taps for figure T1; BGMODEL_RECORDINGS by default.
    unlock
        Draw nothing, but remove the lock and the unfinished files of a killed run.
    """
    check_whole(workers=workers)
    if not Path("figures/Snakefile").is_file():
        raise ValueError("figures are drawn in a checkout of the project: figures/Snakefile")
    try:
        import snakemake  # noqa: F401
    except ImportError as error:
        raise ImportError('figures need Snakemake: pip install ".[figures]"') from error
    folder = Path("figures/fast" if fast else "figures/out")
    names = sorted(f"fig{path.stem[5:]}" for path in Path("figures").glob("*/draw_*.py"))
    short = ", ".join(name.removeprefix("fig") for name in names)
    for target in targets:
        known = target in names or Path(target).parent == folder
        require(known, "targets", f"must be among fig{short} or files in {folder}", target)
    taps_folder = find_recordings(recordings)
    if not unlock:
        _check_unlocked()
        stems = {Path(target).stem for target in targets}
        asked = [name for name in names if not targets or name in stems]
        there = [name for name in asked if (folder / f"{name}.png").is_file()]
        named = f"already there: {len(there)}; each is named when it is drawn"
        print(f"figures to draw in {folder}: {len(asked)}, {named}", flush=True)
    remove_partial_files(folder)
    # Not on Snakemake's command line, which reads a folder named 010 as the number 10.
    os.environ["BGMODEL_RECORDINGS"] = str(taps_folder or "")
    # Steps run in processes held by the file of rules; threads wait for them.
    status = run_snakemake([
        "-s", "figures/Snakefile", "--cores", str(workers), "--rerun-incomplete",
        "--force-use-threads", "--quiet", "all", "--config", f"fast={int(fast)}",
        *["--unlock"] * unlock, "--", *(targets or ["all"]),
    ])  # fmt: skip
    if status:
        _check_unlocked()
        reason = f"Snakemake ended with status {status}"
        raise SystemExit(f"bgmodel: not all figures were drawn: {reason}")
