"""Single faults, put into a clone of the last commit one at a time, and what tests make of them.

A fault is drawn by the seed: its kind, then a place of that kind in all modules. All tests run once
to record which of them execute each line; a fault then has the tests that execute its statement,
up to the first failure. It counts if that test passes with the place rewritten without the fault:
an edit alone is no fault. Left out, since they change words alone: strings, types, messages
(``raise``, ``warn``, ``print``, f-strings), ``__repr__``, hints to the compiler; and tolerances of
rounding, since 20 % more of one is no fault. Why no library: mutmut and cosmic-ray draw no sample;
mutatest runs one command for all faults, and has stood since 2022.
"""

import argparse
import ast
import os
import re
import signal
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import chain
from pathlib import Path
from queue import SimpleQueue
from random import Random
from typing import Any

from coverage import CoverageData

LEFT_OUT = ("compiling", "moved", "version", "__main__")
ONE = (ast.Lt, ast.Gt, ast.Eq, ast.In, ast.Is, ast.Add, ast.Mult, ast.And)
OTHER = (ast.GtE, ast.LtE, ast.NotEq, ast.NotIn, ast.IsNot, ast.Sub, ast.Div, ast.Or)
SWAPPED: dict[type, Any] = dict(zip(ONE + OTHER, OTHER + ONE, strict=True))
LARGEST_TOLERANCE = 1e-5
Fault = tuple[str, Any, Any]
Outcome = tuple[str, str]


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


def measured(clone: Path, cache: Path, file: Path) -> CoverageData:
    """Run all tests once, if the file is not there; return which of them run each line."""
    if not file.exists():
        config = cache / "coverage.ini"
        config.write_text("[run]\nrelative_files = true\nsource = bgmodel, circuits\n")
        options = ["--cov", f"--cov-config={config}", "--cov-context=test", "--cov-report="]
        every = ["-n2", "--dist=loadfile", *options]
        run(clone, cache, every, 7200.0, {"COVERAGE_FILE": str(file)})
    data = CoverageData(str(file))
    data.read()
    return data


def tests_of(covered: CoverageData, clone: Path, path: Path, place: Any) -> list[str]:
    """Return the tests that run a statement, or its module, or a module that imports this one.

    Compiled lines and constants are run by none. A module's own tests come first, slow ones last,
    and one case of every test before further cases.
    """
    nodes = [n for n in ast.walk(ast.parse((clone / path).read_text())) if isinstance(n, ast.stmt)]
    last = max(n.lineno for n in nodes if n.lineno <= place.lineno)
    here = re.compile(rf"^(from|import) .*\b{path.stem}\b", re.MULTILINE)
    users = [p for p in covered.measured_files() if here.search((clone / p).read_text())]

    def names(files: list[str], lines: Any = None) -> set[str]:
        by_line = [covered.contexts_by_lineno(file).items() for file in files]
        some = [of for line, of in chain(*by_line) if lines is None or line in lines]
        return {name.partition("|")[0] for name in chain(*some)} - {""}

    those = names([str(path)], range(last, place.end_lineno + 1)) or names([str(path)])
    slow, cases = (clone / "tests" / "slow.txt").read_text().split("\n"), Counter[str]()
    order = []
    for name in sorted(those or names(users)):
        test = name.partition("[")[0]
        cases[test] += 1
        own = f"/test_{path.stem}.py" in test
        order.append((not own, name in slow or test in slow, cases[test], name))
    return [name for *_, name in sorted(order)]


def run(
    clone: Path, cache: Path, arguments: list[str], limit_s: float, more: dict[str, str]
) -> tuple[int | None, str]:
    """Return pytest's status, None where time was up, and the first test that failed."""
    env = {"PYTHONPATH": str(clone), "NUMBA_CACHE_DIR": str(cache), "PYTHONDONTWRITEBYTECODE": "1"}
    with tempfile.NamedTemporaryFile("w+") as those, tempfile.TemporaryFile("w+") as log:
        those.write("\n".join(arguments))  # thousands of tests are too long for a command
        those.flush()
        options = ["-m", "pytest", "-x", "-rfE", "-p", "no:cacheprovider", "-m", "not validate"]
        command = [sys.executable, *options, f"--timeout={limit_s / 3:.0f}", f"@{those.name}"]
        kept: dict[str, Any] = {
            "cwd": clone,
            "env": os.environ | env | more,
            "start_new_session": True,
        }
        with subprocess.Popen(command, stdout=log, stderr=log, **kept) as job:
            try:
                job.wait(limit_s)
            except subprocess.TimeoutExpired:
                os.killpg(job.pid, signal.SIGKILL)
                return None, ""
        log.seek(0)
        failed = re.search(r"^(?:FAILED|ERROR) (.+?)(?: - .*)?$", log.read(), re.MULTILINE)
    return job.returncode, failed[1] if failed else ""


def tried(clone: Path, path: Path, fault: Fault, tests: list[str], limit_s: float) -> Outcome:
    """Insert a fault and run tests; return the outcome, and which test found it."""
    cache, clean = Path(tempfile.mkdtemp(dir=clone.parent)), clone.parent / "clean"
    (clean / "compiled").mkdir(parents=True, exist_ok=True)
    # Compiled circuits lie under a hash of their sources: faults elsewhere need not compile them.
    (cache / "compiled").symlink_to(clean / "compiled")
    source, (_, place, new) = (clone / path).read_text(), fault
    broken: list[str] = []
    while tests := [test for test in tests if test not in broken]:
        (clone / path).write_text(edited(source, place, new))
        status, failed = run(clone, cache, tests, limit_s, {})
        (clone / path).write_text(edited(source, place, place))
        if status is None:
            return "not judged", f"no end of {len(tests)} tests within {limit_s:.0f} s"
        if status in (0, 5):
            break
        if not failed or run(clone, clean, [failed], limit_s, {})[0] == 0:
            return "caught", failed or "what cannot be imported"
        broken += [failed]
    return "survived", f"of {len(tests)} tests; without the fault fail too: {broken}"


def main() -> None:
    """Draw faults and try them on two cores."""
    parser = argparse.ArgumentParser(description=__doc__)
    for name, value in {"--count": 30, "--seed": 5, "--limit-s": 300}.items():
        parser.add_argument(name, type=int, default=value)
    parser.add_argument("--covered", type=Path, help="lines and their tests, made if absent")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="faults") as folder:
        clones: SimpleQueue[Path] = SimpleQueue()
        for name in ("1", "2"):
            clone = Path(folder) / name / "clone"
            subprocess.run(["git", "clone", "-qs", Path(__file__).parents[2], clone], check=True)
            clones.put(clone)
        covered = measured(clone, clone.parent, options.covered or Path(folder) / "covered")
        inserted = drawn(clone, options.seed, options.count)

        def outcome(fault: tuple[Path, Fault]) -> Outcome:
            mine = clones.get()
            tests = tests_of(covered, mine, fault[0], fault[1][1])
            judged = tried(mine, *fault, tests, options.limit_s)
            clones.put(mine)
            return judged

        with ThreadPoolExecutor(2) as threads:
            outcomes = threads.map(outcome, inserted)
            counts = Counter[str]()
            both = zip(inserted, outcomes, strict=True)
            for number, ((path, fault), (judgement, why)) in enumerate(both, 1):
                old, new = (ast.unparse(node).partition("\n")[0][:70] for node in fault[1:])
                print(f"{number}. {path}:{fault[1].lineno}, {fault[0]}: {old!r} -> {new!r}")
                print("  ", judgement, why, flush=True)
                counts[judgement] += 1
    print(", ".join(f"{count} {judgement}" for judgement, count in counts.items()))


if __name__ == "__main__":
    main()
