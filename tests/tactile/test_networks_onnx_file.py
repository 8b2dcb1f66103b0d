"""A decoder in an ONNX file reads as its network of PyTorch does, without PyTorch."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bgmodel.support.files import read_table
from bgmodel.tactile.decoder import EDGE, Decoder, load_decoder, train
from bgmodel.tactile.networks import OwnNetwork
from tests.helpers import ROOT, refused, run
from tests.tactile.striped import QUICK, pushed_taps, striped_taps

onnx = pytest.importorskip("onnx")
pytest.importorskip("onnxruntime")

MAKERS = {"grating": striped_taps, "edge": pushed_taps}
OPTIONS = {"grating": QUICK, "edge": replace(EDGE, epochs=3, batch=64)}
WITHOUT = """
import sys

class Absent:
    def find_spec(name, *given):
        if name in ("torch", "safetensors", "onnx"):
            raise ModuleNotFoundError(name)

sys.meta_path.insert(0, Absent)
from bgmodel.cli import main
sys.exit(main(sys.argv[1:]))
"""
"""The command line where what trains networks is not installed."""


@pytest.fixture(scope="module", params=["grating", "edge"])
def decoder(request):
    taps = MAKERS[request.param](600, 1)
    return train(taps, seed=3, training=OPTIONS[request.param], about={"taps": request.param})


@pytest.fixture
def stored(decoder, tmp_path):
    return decoder.save(tmp_path / "d.onnx")


def test_both_kinds_of_file_give_the_same_readings(decoder, stored):
    """Within a thousandth of a degree, what single precision leaves; by batches too."""
    fresh = MAKERS[decoder.training.network](200, 2)
    back, readings = Decoder.load(stored), decoder.decode(fresh)
    for name, values in back.decode(fresh).items():
        np.testing.assert_allclose(values, readings[name], rtol=0, atol=1e-3)
    one = back.decode(fresh.select([7]))
    for name, values in readings.items():
        np.testing.assert_allclose(one[name], values[[7]], rtol=0, atol=1e-3)


def test_an_onnx_file_holds_the_whole_decoder(decoder, stored, tmp_path):
    back = Decoder.load(stored)
    np.testing.assert_array_equal(back.rest_mm, decoder.rest_mm)
    np.testing.assert_array_equal(back.trained_on, decoder.trained_on)
    assert back.trained_on.dtype == decoder.trained_on.dtype
    for name in ("training", "history", "about"):
        assert getattr(back, name) == getattr(decoder, name)
    assert back.knows(MAKERS[decoder.training.network](600, 1)).all()
    assert decoder.save(tmp_path / "again.onnx").read_bytes() == stored.read_bytes()
    with refused("path copy the file"):
        back.save(tmp_path / "copy.onnx")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["again.onnx", "d.onnx"]


def test_bad_files_get_one_clear_sentence(decoder, stored, tmp_path):
    model = onnx.load(stored)
    header = json.loads(model.metadata_props[0].value)
    one_pin_less = {**header, "rest_mm": header["rest_mm"][1:]}
    other = "edge" if decoder.training.network == "grating" else "grating"
    of_other = {**header, "training": {**header["training"], "network": other}}

    def with_header(header):
        onnx.helper.set_model_props(model, header and {"bgmodel": json.dumps(header)})
        return model.SerializeToString()

    contents = stored.read_bytes()
    foreign = ROOT / "bgmodel" / "data" / "macaque_likelihood.onnx"
    bad = {
        contents[: len(contents) // 2]: "protobuf",
        b"": "graph",
        b"not a decoder": "protobuf",
        foreign.read_bytes(): "it has no 'training'",
        with_header({}): "another network needs",
        with_header(of_other): "shapes",
    }
    if decoder.training.network == "edge":
        bad[with_header(one_pin_less)] = "shapes"
    for content, reason in bad.items():
        (tmp_path / "bad.onnx").write_bytes(content)
        with refused(f"path does not hold a decoder of this program: .*{reason}"):
            Decoder.load(tmp_path / "bad.onnx")
    with refused("path there is no decoder"):
        Decoder.load(tmp_path / "absent.onnx")


def test_taps_are_decoded_without_pytorch(tmp_path):
    taps, decoder, decoded = (tmp_path / name for name in ("t.npz", "d.onnx", "x.csv"))
    striped_taps(100).save(taps, {})
    quick = ("--training", "width=0.1", "epochs=1", "batch=16")
    assert run("touch", "train", taps, "--save", decoder, *quick) == 0
    assert "device" not in Decoder.load(decoder).about["command"]
    words = [sys.executable, "-c", WITHOUT, "touch", "decode", decoder, taps, "--save", decoded]
    assert subprocess.run(words, cwd=ROOT).returncode == 0
    table = read_table(decoded)
    assert table["trained_on"].all()
    readings = Decoder.load(decoder).decode(striped_taps(100))
    np.testing.assert_allclose(table["psi_deg"], readings["psi_deg"])


def without_header(path):
    """Write a stored decoder again as a network of anyone's."""
    model = onnx.load(path)
    del model.metadata_props[:]
    onnx.save(model, path)
    return path


def exported(layers, taps, path, dtype):
    """Write a network of one layer that is no decoder of this program."""
    torch = pytest.importorskip("torch")
    shape = taps.displacement_mm.shape[1:]
    network = torch.nn.Sequential(torch.nn.Flatten(), *layers(2 * shape[0], torch)).to(dtype)
    torch.onnx.export(network, (torch.zeros(1, *shape, dtype=dtype),), path, dynamo=False,
                      dynamic_axes={"x": {0: "taps"}}, input_names=["x"])  # fmt: skip
    return network


def test_a_network_of_ones_own_is_read_as_stated(tmp_path):
    taps = MAKERS["edge"](200, 2)
    decoder = train(MAKERS["edge"](600, 1), seed=3, training=OPTIONS["edge"])
    path = without_header(decoder.save(tmp_path / "own.onnx"))
    network = OwnNetwork("edge", "displacements", "vector")
    for trained in (None, MAKERS["edge"](600, 1)):
        restored = load_decoder(path, network, trained_on=trained)
        both = restored.decode(taps), decoder.decode(taps)
        pd.testing.assert_frame_equal(*both, check_exact=False, atol=1e-3)
    assert restored.knows(MAKERS["edge"](600, 1)).all()
    assert restored.decode(MAKERS["edge"](600, 1))["trained_on"].all()


@pytest.mark.parametrize(("stimulus", "column"), [("edge", "edge_deg"), ("grating", "psi_deg")])
@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_a_network_may_give_the_angle_itself(stimulus, column, dtype, tmp_path):
    torch = pytest.importorskip("torch")
    taps, kind = MAKERS[stimulus](50, 2), getattr(torch, dtype)
    network = exported(lambda n, t: [t.nn.Linear(n, 1)], taps, tmp_path / "own.onnx", kind)
    restored = load_decoder(tmp_path / "own.onnx", OwnNetwork(stimulus, "displacements", "angle"))
    with torch.no_grad():
        angle = network(torch.from_numpy(taps.displacement_mm).to(kind)).numpy()[:, 0]
    assert np.abs(angle).max() < 90
    np.testing.assert_allclose(restored.decode(taps)[column], angle, atol=1e-4)


def test_a_network_that_is_not_as_stated_is_refused(tmp_path):
    torch = pytest.importorskip("torch")
    taps, path = MAKERS["edge"](50, 2), tmp_path / "own.onnx"
    exported(lambda n, t: [t.nn.Linear(n, 3)], taps, path, torch.float32)
    with refused("network gives 2"):
        load_decoder(path, OwnNetwork("edge", "displacements", "vector")).decode(taps)
    with refused("taps must give the network's input"):
        load_decoder(path, OwnNetwork("edge", "maps", "vector")).decode(taps)
    with refused("taps reads taps of one stimulus"):
        load_decoder(path, OwnNetwork("grating", "displacements")).decode(taps)
    with refused("takes"):
        OwnNetwork(takes="pictures")
    with refused("trained_on no effect"):
        load_decoder(path, trained_on=taps)
    path.write_bytes(b"nothing")
    with refused("path does not hold a network"):
        load_decoder(path, OwnNetwork("edge"))
    with refused("path there is no decoder"):
        load_decoder(tmp_path / "absent.onnx", OwnNetwork("edge"))
    with refused("path must be an .onnx file"):
        load_decoder(Path(__file__), OwnNetwork("edge"))
