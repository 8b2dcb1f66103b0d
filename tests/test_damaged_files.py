"""Damaged files count as absent; files made to exhaust memory or the stack are one sentence."""

import gc
import io
import json
import zipfile

import numba
import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from hypothesis import example, given
from hypothesis import strategies as some

from bgmodel.commands.touch import Step
from bgmodel.experiments.experiment import Experiment
from bgmodel.explorer.state import opened
from bgmodel.fitting.simulated.network import read_network
from bgmodel.support.files import KEY, read_provenance, read_table, write_table
from bgmodel.sweeps.sweep import Sweep
from bgmodel.tactile.decoder import Decoder
from bgmodel.tactile.source import decoder_of
from bgmodel.tactile.taps import Taps
from bgmodel.trials.reader import read_trials
from circuits.arrays import read_arrays
from circuits.compiled_code import compile_cached
from circuits.errors import InputError
from circuits.table_reader import read as read_circuit
from tests.damage import DAMAGES, doubled, flipped

RNG = np.random.default_rng(24_711)
TABLE = pd.DataFrame({"rt": RNG.normal(size=40), "who": [f"p{k % 7}" for k in range(40)]})
TABLE["bin"], TABLE["right"] = RNG.integers(0, 300, 40).astype("int16"), RNG.random(40) < 0.5


@given(share=some.floats(0, 1, exclude_max=True), cut=some.booleans())
def test_a_table_with_a_changed_byte_is_read_as_written_or_refused(tmp_path_factory, share, cut):
    path = tmp_path_factory.getbasetemp() / "some.parquet"
    write_table(TABLE, path, seed=3, rows=[1, 2])
    contents, about = path.read_bytes(), read_provenance(path)
    path.write_bytes(contents[: int(share * len(contents))] if cut else flipped(contents, share))
    try:
        table, behind = read_table(path), read_provenance(path)
    except (OSError, ValueError):
        return
    pd.testing.assert_frame_equal(table, TABLE)
    assert behind == about


def made(*, output, **options):
    """Make a file as a command does, and count."""
    output.save.write_text("whole")
    with output.save.with_suffix(".calls").open("a") as calls:
        calls.write("1")


@pytest.mark.parametrize("damage", ["result", "record"])
def test_a_step_is_made_again_if_its_result_or_the_record_is_damaged(tmp_path, damage):
    result = tmp_path / "x"
    step = Step(result, made, (), {"seed": 1})
    for _ in range(2):
        step.make()
    assert result.with_suffix(".calls").read_text() == "1"
    if damage == "result":
        result.write_text("whale")
    else:
        (record,) = (tmp_path / "steps").iterdir()
        record.write_bytes(record.read_bytes()[:-9])
    for _ in range(2):
        step.make()
    assert result.with_suffix(".calls").read_text() == "11"
    assert result.read_text() == "whole"


DEEP = "[" * 100_000
TOMLS = {
    "keys": ".".join(["a"] * 60_000) + " = 1",
    "keys of a known one": "name." + ".".join(["a"] * 60_000) + " = 1",
    "brackets": "name = " + DEEP,
    "tables": "[" + ".".join(["task"] * 60_000) + "]\nx = 1",
    "quoted keys": " . ".join(['"a"'] * 60_000) + " = 1",
    "a mixture": "name = " + ("{" + ".".join(["a"] * 40) + " = ") * 200 + "1" + "}" * 200,
    "digits": "name = " + "9" * 10_000,
}
READERS = [Experiment.from_toml, Sweep.from_toml, read_circuit, opened]


def assert_refused(read, path, named=""):
    """Assert that reading a file is refused in one sentence, with its name."""
    with pytest.raises(InputError) as error:
        read(path)
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 400
    assert named in str(error.value)


@pytest.mark.parametrize("text", TOMLS.values(), ids=TOMLS)
@pytest.mark.parametrize("read", READERS)
def test_a_deep_toml_file_is_refused(tmp_path, read, text):
    path = tmp_path / "mine.toml"
    path.write_text(text)
    # What other tests left would else be collected at the end of the stack, where that fails.
    gc.collect()
    gc.disable()
    try:
        assert_refused(read, str(path), "mine.toml")
    finally:
        gc.enable()


def npz(path, **arrays):
    """Write arrays as np.savez does; text stays text, and bytes are not changed."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, values in arrays.items():
            stream = io.BytesIO()
            if not isinstance(values, bytes):
                np.save(stream, values)
            file.writestr(f"{name}.npy", values if isinstance(values, bytes) else stream.getvalue())


def claiming(shape):
    """Return an array of little content whose header says that it has another shape."""
    stream = io.BytesIO()
    header = {"descr": "<f4", "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(stream, header)
    return stream.getvalue() + bytes(16)


TAPS = {
    "displacement_mm": np.zeros((1, 1, 2), np.float32),
    "rest_mm": np.zeros((1, 2)),
    "label_yaw_deg": np.zeros(1),
    "stimulus": np.array("grating"),
    "about": np.array("{}"),
}


@pytest.mark.parametrize(
    "changed",
    [
        {"displacement_mm": claiming((10**12, 300, 2))},
        {"displacement_mm": claiming((10**30, 300, 2))},
        {"displacement_mm": claiming((-1, 300, 2))},
        {"displacement_mm": np.zeros((1, 1, 2), object)},
        {"rest_mm": np.zeros(())},
        {"about": np.array(DEEP)},
        {"about": claiming((10**12,))},
        {"label_yaw_deg": np.zeros((1, 1, 1))},
    ],
    ids=lambda changed: next(iter(changed)),
)
def test_taps_that_say_absurd_things_are_refused(tmp_path, changed):
    path = tmp_path / "taps.npz"
    npz(path, **TAPS)
    assert len(Taps.load(path)[0]) == 1
    npz(path, **{**TAPS, **changed})
    assert_refused(Taps.load, path, "taps.npz")


@pytest.mark.parametrize("text", [DEEP, "[]", "3", '{"parameters": 3}', "9" * 10_000])
def test_provenance_that_is_none_is_refused(tmp_path, text):
    mine, yours = tmp_path / "mine.csv", tmp_path / "yours.parquet"
    write_table(pd.DataFrame({"x": [1]}), mine)
    (tmp_path / "mine.csv.json").write_text(text)
    table = pq.read_table(write_table(pd.DataFrame({"x": [1]}), yours))
    pq.write_table(table.replace_schema_metadata({KEY: text.encode()}), yours)
    for path in (mine, yours):
        with pytest.raises(ValueError, match=r"."):
            read_provenance(path)
        assert decoder_of(path) == {}
        assert read_table(path)["x"].tolist() == [1]
    with pytest.raises(InputError):
        write_table(pd.DataFrame({"x": [1]}), mine)


def test_a_parquet_file_of_something_else_is_refused(tmp_path):
    path = tmp_path / "mine.parquet"
    for content in (b"", b"PAR1", b"PAR1" + bytes(40) + b"PAR1", b"PAR1\xff\xff\xff\x7fPAR1"):
        path.write_bytes(content)
        for read in (read_table, read_trials):
            assert_refused(read, path, "can't be read as")


def test_decoders_that_say_absurd_things_are_refused(tmp_path):
    torch = pytest.importorskip("torch")
    from safetensors.numpy import save_file

    path = tmp_path / "mine.safetensors"
    good = {"training": {"network": "edge"}, "history": [], "about": {}}
    arrays = {"rest_mm": np.zeros((3, 2)), "trained_on": np.zeros(1, np.int64)}
    headers = [
        DEEP, "[]", "{}", json.dumps(good), json.dumps({**good, "training": {"width": 1e9}}),
        json.dumps({**good, "training": {"network": "edge", "width": 1e7}}),
        json.dumps({**good, "training": {"network": "edge", "width": "wide"}}),
        json.dumps({**good, "training": 3}),
    ]  # fmt: skip
    for header in headers:
        save_file(arrays, path, {"bgmodel": header})
        assert_refused(Decoder.load, path)
    assert torch.zeros(1).device.type == "cpu"


def test_networks_that_say_absurd_things_are_refused(tmp_path):
    onnx = pytest.importorskip("onnx")
    path = tmp_path / "mine.onnx"
    graph = onnx.helper.make_graph([], "g", [], [])
    tensor = onnx.helper.make_tensor("bias_0", onnx.TensorProto.FLOAT, [1], [1.0])
    for header, dims in ((DEEP, 1), ("{}", 1), ("{}", 10**12), ("3", 1)):
        model = onnx.helper.make_model(graph)
        kept = model.graph.initializer.add()
        kept.CopyFrom(tensor)
        kept.dims[0] = dims
        onnx.helper.set_model_props(model, {"bgmodel": header})
        path.write_bytes(model.SerializeToString())
        assert_refused(read_network, path, "mine.onnx")
        with pytest.raises(InputError):
            Decoder.load(path)


SOURCES = "0123456789abcdef"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    return tmp_path


def compiled():
    """Return a function as in a new process, its results, and how many came from the cache."""
    function = compile_cached(doubled, SOURCES)
    return function(21), function(0.25), sum(function.stats.cache_hits.values())


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
@pytest.mark.parametrize("ending", [".nbi", ".1.nbc", ".2.nbc"])
def test_damaged_code_is_compiled_again_and_written_whole(folder, ending, damage):
    assert compiled() == (42, 0.5, 0)
    assert compiled() == (42, 0.5, 2)
    (file,) = folder.rglob(f"*{ending}")
    contents = file.read_bytes()
    file.write_bytes(damage(contents))
    value, other, hits = compiled()
    assert (value, other) == (42, 0.5)
    assert hits <= (2 if ending == ".nbi" else 1)  # not every byte of an index matters
    assert compiled() == (42, 0.5, 2)


def test_code_of_another_function_is_not_loaded(folder):
    compiled()
    first, second = sorted(folder.rglob("*.nbc"))
    first.write_bytes(second.read_bytes())
    assert compiled() == (42, 0.5, 1)


ARRAYS = {"x": np.arange(5.0), "of": np.array([[1, 2]], np.int16), "name": np.array("one")}


@given(share=some.floats(0, 1, exclude_max=True), cut=some.booleans())
@example(share=0.88, cut=False)  # hides an entry of the directory
def test_arrays_with_a_changed_byte_are_read_as_written_or_not_at_all(tmp_path_factory, share, cut):
    path = tmp_path_factory.getbasetemp() / "some.npz"
    np.savez(path, **ARRAYS)
    contents = path.read_bytes()
    path.write_bytes(contents[: int(share * len(contents))] if cut else flipped(contents, share))
    try:
        arrays = read_arrays(path)
    except (OSError, ValueError):
        return
    assert arrays.keys() == ARRAYS.keys()
    for name, values in ARRAYS.items():
        assert arrays[name].tobytes() == values.tobytes()
        assert (arrays[name].dtype, arrays[name].shape) == (values.dtype, values.shape)
