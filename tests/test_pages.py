"""The blocks of the README and of the site run as a reader would run them, and links lead there."""

import ast
import json
import os
import re
import shlex
import subprocess
from inspect import signature
from itertools import groupby

import pytest
from sybil.document import Document
from sybil.parsers.markdown import CodeBlockParser, PythonCodeBlockParser

from bgmodel.bootstrap import FEWEST_TRIALS
from bgmodel.cli import main, parsed
from tests.helpers import ROOT, prose

DOCS = ROOT / "docs"
GUIDES = sorted((DOCS / "guides").glob("*.md"))
RESULTS = sorted((DOCS / "results").glob("*.md"))
RUN = [ROOT / "README.md", DOCS / "index.md", DOCS / "concepts.md", *GUIDES]
"""Pages whose blocks are run; `docs/extending.md` has a separate test."""
TUTORIALS = [*(DOCS / "tutorials").glob("*.md"), *sorted((DOCS / "tutorials").glob("*.ipynb"))]
TOP = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(DOCS.glob("*.md"))]
PAGES = [*TOP, *GUIDES, *RESULTS, *TUTORIALS]
MADE = {DOCS / "gallery.md", DOCS / "references.md"}
"""Pages that `make docs` writes."""

# Commands that are parsed and not run, by how they begin, and why.
PARSED = {
    "bgmodel explore": "it serves a page until it is interrupted; tests of the explorer do so",
    "bgmodel demo": "it takes half a minute; a test of the demo does the same",
    "bgmodel learn --task period_mm=2": "it takes many seconds; a test of the command learns less",
    "bgmodel touch": "it takes minutes or waits for images; tests of the commands do less",
    "bgmodel decide --task edge-turn": "there is no table of decoded taps",
    "bgmodel fit trials.csv --strength contrast --formula": "tests of formulas fit one",
    "bgmodel fit search.csv": "there is no such table; a test of the command writes one",
    "bgmodel fit go_no_go.csv": "there is no such table; tests of trials without times make one",
    "bgmodel fit theirs.csv": "there is no such table; a test of the command writes one",
    "bgmodel compare": "1 000 trials take minutes; a test of the command compares a hundred",
    "bgmodel fit clicks": "there is no such table; a test of the command writes one",
    "bgmodel exam    #": "the whole exam takes a minute; a guide asks for one domain",
    "bgmodel exam macaque --plot": "the whole exam takes a minute; a line below asks less",
    "bgmodel exam mine.toml": "there is no such file; a test of the exam takes a circuit",
    "bgmodel exam --data": "there are no such tables; a test of the exam writes them",
    "bgmodel fit roitman": "it takes a minute; a test of the command fits less",
    "bgmodel fit cavanagh": "it takes minutes; a test of the command fits four people",
    "bgmodel fit stop": "it fits 126 people; a test of the command fits four",
    "bgmodel experiment mine.toml --engine spikes": "spikes take minutes; the next line runs it",
    "bgmodel experiment stn_conflict --save": "2 000 trials; mine.toml runs 200",
    "bgmodel experiment lesion.toml --engine": "spikes take minutes; the line before runs it",
    "bgmodel circuit run --plot stop.png": "4 000 trials; a test of the command runs fewer",
}
# Blocks of Python that only `make validate` runs, by what they hold, and why; `make test` tries
# their imports.
LONG = {
    'for model in ("constant_gap", "falling_gap"):': "two fits to a monkey; tests of gaps fit less",
    '["rest.stn", "rest.snr"]': "it simulates rates at rest; tests of tuning compute them",
    "recorded=pilot": "it fits forty simulated pilots; tests of recorded cells fit fewer",
    "noise_ceiling=True": "three circuits are run; a test of the comparison does less",
}
TABLES = {"evidence.md": "mine.csv", "your_trials.md": "trials.csv"}
"""The name of the table in CSV on a page. A block of TOML has its own name in its first line."""


def name(path):
    return str(path.relative_to(ROOT))


def blocks(language, pages=RUN):
    """Return the blocks of one language, each with its page and line as its name."""
    parser = CodeBlockParser(language, lambda example: None)
    parser = PythonCodeBlockParser() if language == "python" else parser
    return [
        pytest.param(example, id=f"{name(page)} line {example.line}")
        for page in pages
        for example in Document.parse(str(page), parser).examples()
    ]


def lines(example):
    """Yield the commands of a console block, without their output."""
    for line in str(example.parsed).splitlines():
        if line.startswith("$ "):
            yield line[2:]


def commands(example):
    """Yield the arguments of every ``bgmodel`` command of a console block, and its line."""
    for line in lines(example):
        words = shlex.split(line, comments=True)
        for then, part in groupby(words, lambda word: word == "&&"):
            program, *arguments = part
            if not then and program == "bgmodel":
                yield arguments, line


def own_files():
    """Yield the name and text of every file that a page shows for its reader to save."""
    for page in RUN:
        for block in blocks("csv", [page]):
            yield TABLES[page.name], str(block.values[0].parsed)
        for block in blocks("toml", [page]):
            text = str(block.values[0].parsed)
            yield text.splitlines()[0].removeprefix("# "), text


@pytest.fixture(params=["few trials", pytest.param("all", marks=pytest.mark.validate)])
def in_full(request):
    """Return whether blocks run as they stand, or on fewer trials."""
    return request.param == "all"


@pytest.fixture
def fewer(in_full):
    """Return a function that lowers a number of trials, to no fewer than an interval needs."""

    def lowered(count, interval):
        if in_full:
            return str(count)
        return str(min(int(count), max(FEWEST_TRIALS if interval else 20, int(count) // 10)))

    return lowered


@pytest.fixture
def folder(tmp_path, monkeypatch, fewer):
    """Go to an empty folder that holds the pages' own tables, experiments and sweeps."""
    for file, text in own_files():
        (tmp_path / file).write_text(
            re.sub(r"(?<=^trials = )\d+", lambda n: fewer(n[0], True), text, flags=re.MULTILINE)
        )
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("example", blocks("python"))
def test_a_python_block_runs(example, folder, in_full, fewer, capsys):
    text, first = str(example.parsed), example.path.endswith("README.md")
    interval = "compare(" in text
    if not first:
        text = re.sub(r"(?<=separated_evidence\()\d+", lambda n: fewer(n[0], interval), text)
    if not in_full:
        # Learners are judged by their last 500 trials.
        learner = r"(?<=WeightLearner\(trials=)\d+"
        text = re.sub(learner, lambda n: str(min(int(n[0]), 500)), text)
    names = {"__name__": "__main__"}
    if not in_full and any(part in text for part in LONG):
        imports = [x for x in ast.parse(text).body if isinstance(x, ast.Import | ast.ImportFrom)]
        exec(compile(ast.Module(imports, []), example.path, "exec"), names)
        return
    exec(compile(text, example.path, "exec"), names)
    assert capsys.readouterr().out
    if first:
        # A first impression of few trials: a circuit faster than the optimal test.
        rows = names["comparison"].table.query("model == 'circuit' and reference == 'MSPRT'")
        assert rows.set_index("measure")["low"]["extra_ms"] > 0


@pytest.mark.parametrize("example", blocks("console"))
def test_a_command_runs_or_at_least_parses(example, folder, in_full, fewer):
    for arguments, line in commands(example):
        command = parsed(arguments)
        if not line.startswith(tuple(PARSED)):
            options = signature(command.func).parameters
            if "workers" in options and "--workers" not in arguments:
                arguments += ["--workers", "1"]  # a process more takes longer than its trials
            interval = arguments[:2] != ["circuit", "run"]
            lower = lambda found: f"trials={fewer(found[1], interval)}"  # noqa: B023, E731
            arguments = [re.sub(r"^trials=(\S+)$", lower, word) for word in arguments]
            if "--trials" in arguments:
                at = arguments.index("--trials") + 1
                arguments[at] = fewer(arguments[at], interval)
            if "runs" in options and not in_full:
                arguments = [*without(arguments, "--runs"), "--runs", "1"]
            assert main(arguments) == 0


def without(arguments, option):
    """Return arguments without an option and its value."""
    at = arguments.index(option) if option in arguments else len(arguments)
    return [*arguments[:at], *arguments[at + 2 :]]


def saved_by(command):
    """Return the file that a command saves its result to, if it does."""
    return getattr(command.keywords.get("output"), "save", None)


def test_no_command_of_a_page_writes_over_the_file_of_another():
    sources = [file for file, _ in own_files()]
    assert len(set(sources)) == len(sources)
    for page in RUN:
        told = [c for block in blocks("console", [page]) for c, _ in commands(block.values[0])]
        outputs = [saved_by(parsed(c)) for c in told]
        written = [str(path) for path in outputs if path is not None]
        assert len({*written, *sources}) == len(written) + len(sources)


def test_every_exception_is_of_a_command_or_a_block_that_is_there():
    told = [line for block in blocks("console") for line in lines(block.values[0])]
    assert [s for s in PARSED if not any(line.startswith(s) for line in told)] == []
    shown = [str(block.values[0].parsed) for block in blocks("python", GUIDES)]
    assert [part for part in LONG if sum(part in text for text in shown) != 1] == []


def test_the_script_of_an_array_of_jobs_runs_a_line_until_it_succeeds(tmp_path):
    (script,) = (text for block in blocks("sh") if "sed -n" in (text := block.values[0].parsed))
    (tmp_path / "commands.txt").write_text("echo one >> ran\necho two >> ran; [ -e fine ]\n")

    def job(number):
        options = {"cwd": tmp_path, "env": os.environ | {"SLURM_ARRAY_TASK_ID": number}}
        return subprocess.run(["bash", "-c", str(script)], check=False, **options).returncode

    assert [job("1"), job("2")] == [0, 1]
    (tmp_path / "fine").touch()
    assert [job("1"), job("2"), job("2")] == [0, 0, 0]
    assert (tmp_path / "ran").read_text().split() == ["one", "two", "two"]


def test_the_readme_is_short():
    assert len((ROOT / "README.md").read_text().splitlines()) <= 130


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_make_has_every_target_that_a_page_names(page):
    targets = set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    assert set(re.findall(r"(?:`|\$ )make ([\w-]+)", prose(page))) <= targets


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_every_file_that_a_page_names_is_there(page):
    folders = "bgmodel|circuits|figures|benchmarks|tests|docs"
    paths = re.findall(rf"`((?:{folders})/[^`\s]*)`", prose(page))
    made = ("figures/out", "figures/fast", "benchmarks/out", "docs/_build")
    # What a recipe of `docs/extending.md` lets its reader write is there once it is followed.
    listed = re.findall(r"^# (\S+\.\w+)$", prose(page), re.MULTILINE)
    wanted = [p for p in paths if not p.startswith(made) and p not in listed]
    assert [p for p in wanted if not (ROOT / p).exists()] == []


def anchors(page):
    """Return the anchors of a page's headings, as GitHub and MyST make them."""
    titles = re.findall(r"^#+ (.+)$", prose(page), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_every_link_leads_to_a_page_and_a_heading_that_are_there(page):
    text = prose(page)
    links = re.findall(r"\]\(((?!http)[^)\s]+)\)", text) + re.findall(r'src="([^"]+)"', text)
    for link in links:
        path, _, anchor = link.partition("#")
        target = page.parent / path if path else page
        assert target.resolve() in MADE or target.exists(), link
        assert not anchor or anchor in anchors(target), link


def test_every_page_of_the_site_is_in_its_contents():
    folders = ("", "guides", "results", "tutorials")
    indexes = [*(DOCS / folder / "index.md" for folder in folders), DOCS / "about.md"]
    entries = {
        str(index.parent / entry)
        for index in indexes
        for block in re.findall(r"```{toctree}\n(.+?)```", index.read_text(), re.DOTALL)
        for entry in re.findall(r"^(?:.+<)?([\w/]+)>?$", block, re.MULTILINE)
    }
    pages = {page for page in PAGES if page.is_relative_to(DOCS)} | MADE
    assert {str(page.with_suffix("")) for page in pages - {DOCS / "index.md"}} == entries


def test_every_seed_that_scores_or_tunes_is_named():
    text = (ROOT / "docs" / "measured.md").read_text()
    seeds = text.partition("## Seeds")[2].partition("## Intervals")[0]
    named = {int(number) for number in re.findall(r"\b\d{3,5}\b", seeds)}
    file_of_seed = {}
    for path in [
        *(ROOT / "benchmarks").rglob("*.py"),
        *(ROOT / "figures").rglob("*.py"),
        *(ROOT / "tests/validation").glob("*.py"),
    ]:
        for line in re.findall(r"^[A-Z_]*SEEDS? = .*$", path.read_text(), re.MULTILINE):
            for number in re.findall(r"\b\d[\d_]{2,}\b", line):
                # The end of a range is not drawn.
                value = int(number) - line.startswith("SCORING_SEEDS = range") * (number == "121")
                file_of_seed[value] = path.name
    assert len(file_of_seed) > 5
    assert {number: name for number, name in file_of_seed.items() if number not in named} == {}


NOTEBOOKS = sorted((ROOT / "docs" / "tutorials").glob("*.ipynb"))
PLACES = re.compile(r"(?:/home|/root|/tmp|/work|/Users|/usr|/opt|[A-Z]:\\\\)[/\\]?\w|ipykernel_\d")
"""Paths of a machine."""


@pytest.fixture(params=NOTEBOOKS, ids=lambda path: path.stem)
def notebook(request):
    return json.loads(request.param.read_text(encoding="utf-8"))


def code(notebook):
    return [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]


def test_every_code_cell_was_executed_in_order_with_an_output(notebook):
    cells = code(notebook)
    assert [cell["execution_count"] for cell in cells] == list(range(1, len(cells) + 1))
    assert [cell["id"] for cell in cells if not cell["outputs"]] == []
    kinds = {output["output_type"] for cell in cells for output in cell["outputs"]}
    assert "error" not in kinds


def test_no_output_names_a_place_on_a_machine(notebook):
    for cell in code(notebook):
        for output in cell["outputs"]:
            shown = {k: v for k, v in output.get("data", {}).items() if not k.startswith("image")}
            assert not PLACES.search(json.dumps([shown, output.get("text")])), cell["id"]
