"""Single faults, put into a clone of the last commit one at a time, and what tests make of them.

A fault is drawn by the seed: its kind, then a place of that kind in all modules. The module's own
tests run first, then all others, those that name it before the rest, up to the first failure. It
counts if that test passes with the place rewritten without the fault: an edit alone is no fault.
Left out, since they change words alone: strings, types, messages (``raise``, ``warn``, ``print``,
f-strings), ``__repr__``, hints to the compiler; and tolerances of rounding, since 20 % more
of one is no fault. A test that does not end fails. Why no library: mutmut and cosmic-ray draw no
sample; mutatest runs one command for all faults, and has stood since 2022.
"""

import argparse
import ast
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from random import Random
from typing import Any

LEFT_OUT = ("compiling", "moved", "version", "__main__")
ONE = (ast.Lt, ast.Gt, ast.Eq, ast.In, ast.Is, ast.Add, ast.Mult, ast.And)
OTHER = (ast.GtE, ast.LtE, ast.NotEq, ast.NotIn, ast.IsNot, ast.Sub, ast.Div, ast.Or)
SWAPPED: dict[type, Any] = dict(zip(ONE + OTHER, OTHER + ONE, strict=True))
LARGEST_TOLERANCE = 1e-5
Fault = tuple[str, Any, Any]


def fault_at(node: ast.AST) -> Fault:
    """Return the kind, the place and what comes there of the fault that a node takes."""
    match node:
        case ast.Compare(left, [op], right):
            return "comparison", node, ast.Compare(left, [SWAPPED[type(op)]()], right)
        case ast.BinOp(left, op, right) if type(op) in SWAPPED:
            return "arithmetic", node, ast.BinOp(left, SWAPPED[type(op)](), right)
        case ast.BoolOp(op, values):
            return "and, or", node, ast.BoolOp(SWAPPED[type(op)](), values)
        case ast.UnaryOp(ast.Not(), operand):
            return "not", node, operand
        case ast.Constant(float(value)) if value > LARGEST_TOLERANCE:
            return "constant by 20 %", node, ast.Constant(1.2 * value)
        case ast.Constant(int(value)) if not isinstance(value, bool):
            return "off by one", node, ast.Constant(value + 1)
        case ast.FunctionDef(body=[*_, ast.Return(ast.expr())]):
            return "early return", node.body[ast.get_docstring(node) is not None], ast.Return()
    return "", node, node


def faults(node: ast.AST) -> Iterator[Fault]:
    """Yield all faults at a node and below."""
    text = ast.unparse(node) if isinstance(node, ast.If | ast.Call | ast.FunctionDef) else ""
    words = re.match(r"(\w+\.)*(warn|print|lacks)\(|if TYPE_CHECKING|def __repr__", text)
    if words or isinstance(node, ast.Raise | ast.JoinedStr):
        return
    yield from [fault_at(node)] if fault_at(node)[0] else []
    for name, value in ast.iter_fields(node):
        if name not in ("annotation", "returns", "decorator_list"):
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST):
                    yield from faults(child)


def edited(source: str, place: ast.expr | ast.stmt, new: ast.AST) -> str:
    """Return the source with another text at a place; an expression stays one, whatever is next."""
    lines = source.encode().splitlines(keepends=True)
    start, end = ((n or 1) - 1 for n in (place.lineno, place.end_lineno))
    before = b"".join(lines[:start]) + lines[start][: place.col_offset]
    after = lines[end][place.end_col_offset :] + b"".join(lines[end + 1 :])
    text = ast.unparse(new) if isinstance(place, ast.stmt) else f"({ast.unparse(new)})"
    text = text.replace("\n", "\n" + " " * place.col_offset)
    return (before + text.encode() + after).decode()


def drawn(clone: Path, seed: int, count: int) -> list[tuple[Path, Fault]]:
    """Draw faults: a kind, then a place of that kind in all modules."""
    by_line: dict[str, list[tuple[Path, Fault]]] = {}
    for path in sorted([*clone.glob("circuits/**/*.py"), *clone.glob("bgmodel/**/*.py")]):
        for fault in faults(ast.parse("" if path.stem in LEFT_OUT else path.read_text())):
            by_line.setdefault(fault[0], []).append((path.relative_to(clone), fault))
    rng = Random(seed)
    return [rng.choice(by_line[rng.choice(sorted(by_line))]) for _ in range(count)]


def tests_of(clone: Path, path: Path) -> tuple[list[str], list[str]]:
    """Return files of a module's own tests (or its folder's); all others, those that name it first.

    What names a test's module counts too: a command tests what it calls.
    """
    home = clone / "tests" / path.relative_to("" if path.parts[0] == "circuits" else "bgmodel")
    every = [p for p in sorted(clone.glob("tests/**/test_*.py")) if p.parent.name != "validation"]
    same = [p for p in every if p == home.with_name(f"test_{path.stem}.py")]
    same = same or [p for p in every if p.parent == home.parent != clone / "tests"]
    here = re.compile(rf"{'[.]'.join(path.parts[:-1])}(\.| import .*\b){path.stem}\b")
    users = {f"test_{p.stem}" for p in clone.glob("*/**/*.py") if here.search(p.read_text())}
    near = [p for p in every if p not in same and (p.stem in users or here.search(p.read_text()))]
    far = [p for p in every if p not in same + near]
    first, rest = ([str(p.relative_to(clone)) for p in files] for files in (same, near + far))
    return first, rest


def run(clone: Path, cache: Path, tests: list[str], until: float) -> tuple[int | None, str]:
    """Return pytest's status, None where time was up, and the first test that failed."""
    env = {"PYTHONPATH": str(clone), "NUMBA_CACHE_DIR": str(cache), "PYTHONDONTWRITEBYTECODE": "1"}
    options = ["-m", "pytest", "-x", "-rfE", "-p", "no:cacheprovider", "-m"]
    command = [sys.executable, *options, "not validate", *tests]
    kept: dict[str, Any] = {"cwd": clone, "env": os.environ | env, "start_new_session": True}
    with tempfile.TemporaryFile("w+") as log:
        with subprocess.Popen(command, stdout=log, stderr=log, **kept) as job:
            try:
                job.wait(max(until - time.monotonic(), 1.0))
            except subprocess.TimeoutExpired:
                os.killpg(job.pid, signal.SIGKILL)
                return None, ""
        log.seek(0)
        failed = re.search(r"^(?:FAILED|ERROR) (.+?)(?: - .*)?$", log.read(), re.MULTILINE)
    return job.returncode, failed[1] if failed else tests[0]


def tried(clone: Path, path: Path, fault: Fault, limits_s: list[float]) -> tuple[str, str]:
    """Insert a fault and run tests; return the outcome, and which test found it."""
    cache, clean = Path(tempfile.mkdtemp(dir=clone.parent)), clone.with_name("clean")
    (clean / "compiled").mkdir(parents=True, exist_ok=True)
    # Compiled circuits lie under a hash of their sources: faults elsewhere need not compile them.
    (cache / "compiled").symlink_to(clean / "compiled")
    source, (_, place, new) = (clone / path).read_text(), fault
    broken: list[str] = []
    for number, tests in enumerate(tests_of(clone, path)):
        # The rest of the suite takes minutes: on two cores.
        status: int | None = 1
        shared, until = ["-n2"] if number else [], time.monotonic() + limits_s[number]
        while tests and status not in (0, 5):
            (clone / path).write_text(edited(source, place, new))
            each = f"--timeout={limits_s[number] / 3:.0f}"
            chosen = [*tests, *shared, each, *(f"--deselect={test}" for test in broken)]
            status, failed = run(clone, cache, chosen, until)
            (clone / path).write_text(edited(source, place, place))
            if status is None or failed in broken:
                return ("not judged", "survived")[number], f"no end of {tests[0]} and others"
            if status not in (0, 5):
                if run(clone, clean, [failed], time.monotonic() + limits_s[number])[0] == 0:
                    return "caught", failed
                broken += [failed]
    return "survived", " ".join(broken)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    for name, value in {"--count": 30, "--seed": 5, "--own-s": 200, "--rest-s": 900}.items():
        parser.add_argument(name, type=int, default=value)
    arguments, outcomes = parser.parse_args(), []
    with tempfile.TemporaryDirectory(prefix="faults") as folder:
        clone = Path(folder) / "clone"
        subprocess.run(["git", "clone", "-qs", Path(__file__).parents[2], clone], check=True)
        for number, (path, fault) in enumerate(drawn(clone, arguments.seed, arguments.count), 1):
            old, new = (ast.unparse(node).partition("\n")[0][:70] for node in fault[1:])
            started = time.monotonic()
            print(f"{number}. {path}:{fault[1].lineno}, {fault[0]}: {old!r} -> {new!r}")
            outcomes.append(tried(clone, path, fault, [arguments.own_s, arguments.rest_s]))
            subprocess.run(["git", "-C", clone, "checkout", "-q", "."], check=True)
            print("  ", *outcomes[-1], f"({time.monotonic() - started:.0f} s)", flush=True)
    print(len([o for o in outcomes if o[0] == "caught"]), f"of {arguments.count} caught")
