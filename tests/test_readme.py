"""The blocks of the README run, as a reader would run them."""

import re
import shlex
from itertools import groupby

import pytest
from sybil.document import Document
from sybil.parsers.markdown import CodeBlockParser, PythonCodeBlockParser

from bgmodel.cli import main, parsed
from tests.helpers import ROOT

# Commands that are parsed and not run, by how they begin, and why.
PARSED = {
    "bgmodel simulate": "it solves contacts for minutes; a test of the command does less",
    "bgmodel decode": "there is no decoder where nothing was trained",
    "bgmodel figures": "figures take an hour",
    "bgmodel train my_taps": "it needs recordings",
    "bgmodel compare": "1 000 trials take minutes; a test of the command compares a hundred",
    "bgmodel circuit lesion": "it runs three edited circuits on 1 000 trials",
    "bgmodel experiment stn_conflict": "it runs 1 000 trials; the README's own experiment runs",
}


OWN = {"csv": ["mine.csv"], "toml": ["mine.toml", "lesions.toml"]}
"""The files that the README's commands read: its own blocks, in their order."""


def blocks(language):
    """Return the README's blocks of one language, each with its line as its name."""
    parser = CodeBlockParser(language, lambda example: None)
    parser = PythonCodeBlockParser() if language == "python" else parser
    found = Document.parse(str(ROOT / "README.md"), parser).examples()
    return [pytest.param(example, id=f"line {example.line}") for example in found]


def lines(example):
    """Yield the commands of a console block; what they print is left out."""
    for line in str(example.parsed).splitlines():
        if line.startswith("$ "):
            yield line[2:]


def commands(example):
    """Yield the arguments of every ``bgmodel`` command of a console block, and its line."""
    for line in lines(example):
        words = shlex.split(line, comments=True)
        for then, part in groupby(words, lambda word: word == "&&"):
            name, *arguments = part
            if not then and name == "bgmodel":
                yield arguments, line


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Go to an empty folder that holds the README's own table, experiment and sweep."""
    for language, names in OWN.items():
        examples = [block.values[0] for block in blocks(language)]
        for name, example in zip(names, examples, strict=True):
            (tmp_path / name).write_text(str(example.parsed))
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("example", blocks("python"))
def test_a_python_block_runs_as_it_stands(example, folder, capsys):
    example.namespace.clear()
    example.evaluate()
    assert capsys.readouterr().out


@pytest.mark.parametrize("example", blocks("console"))
def test_a_command_runs_or_at_least_parses(example, folder):
    for arguments, line in commands(example):
        parsed(arguments)
        if not line.startswith(tuple(PARSED)):
            assert main(arguments) == 0


def test_no_command_writes_over_the_file_of_another():
    told = [c for block in blocks("console") for c, _ in commands(block.values[0])]
    outputs = [getattr(parsed(arguments), "output", None) for arguments in told]
    written = [str(path) for path in outputs if path is not None]
    assert len({*written, "mine.csv", "mine.toml"}) == len(written) + 2


def test_every_exception_is_of_a_command_that_is_there():
    told = [line for block in blocks("console") for line in lines(block.values[0])]
    assert [s for s in PARSED if not any(line.startswith(s) for line in told)] == []


def test_make_has_every_target_that_the_documents_name():
    targets = set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    for name in ("README.md", "CONTRIBUTING.md"):
        text = (ROOT / name).read_text()
        assert set(re.findall(r"(?:`|\$ )make ([\w-]+)", text)) <= targets


def test_every_file_that_the_documents_name_is_there():
    for name in ("README.md", "CONTRIBUTING.md"):
        text = (ROOT / name).read_text()
        paths = re.findall(r"`((?:bgmodel|circuits|figures|benchmarks|tests|docs)/[^`\s]*)`", text)
        paths += re.findall(r"\]\(((?!http)[^)#]+)", text)
        made = ("figures/out", "figures/fast", "benchmarks/out")
        assert [p for p in paths if not p.startswith(made) and not (ROOT / p).exists()] == []
