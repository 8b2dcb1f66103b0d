"""The command `watch`: images are decided on as they arrive."""

import os
import threading
import time
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from bgmodel.from_images import Watched, images
from bgmodel.support.files import read_table
from bgmodel.tactile.decoder import EDGE, Decoder, train
from bgmodel.tactile.recordings import Tracker, read_taps
from bgmodel.tactile.task import EdgeTurn
from tests.helpers import run, told
from tests.tactile.recorded import MM_PER_PX, draw, edge_taps, hexagon, record, write

STEP_DEG = 90.0
BRIEF = replace(EDGE, epochs=8)
"""Directions are 90 degrees apart."""


@pytest.fixture(scope="module")
def sensor(tmp_path_factory):
    """Train a decoder on drawn taps of an edge, and decode others."""
    folder = tmp_path_factory.mktemp("sensor")
    taps = read_taps(record(folder / "taps", np.linspace(-180, 179, 360)), mm_per_px=MM_PER_PX)
    decoder, trained = folder / "edge.safetensors", train(taps, seed=1, training=BRIEF)
    trained.save(decoder)
    trained.save(decoder.with_suffix(".onnx"))
    decoded = folder / "decoded.csv"
    edge_taps(600, 25, seed=2).to_csv(decoded, index=False)
    return folder, decoder, decoded, taps


def arriving(folder, sources, gap_s=0.02):
    """Put images into a folder one by one, each whole at once."""

    def put():
        for k, source in enumerate(sources):
            time.sleep(gap_s)
            partial = folder / f".partial{k}"
            partial.write_bytes(source.read_bytes())
            partial.rename(folder / f"image_{k:04d}.png")

    thread = threading.Thread(target=put)
    thread.start()
    return thread


def test_one_image_is_read_as_a_folder_of_them_is(sensor):
    _, _, _, taps = sensor
    tracker = Tracker(taps.rest_mm, MM_PER_PX, "edge")
    for k in (0, 100, 359):
        one = tracker.read(taps.labels["image"][k])
        np.testing.assert_array_equal(one.displacement_mm[0], taps.displacement_mm[k])


@pytest.mark.parametrize(
    ("who", "ending"), [(("--by", "test"), ".onnx"), (("--engine", "population"), ".safetensors")]
)
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_images_are_decided_on_as_they_arrive(who, ending, sensor, tmp_path, capsys, monkeypatch):
    """Ten images of a direction, then ten of the other: each decision is on one of them."""
    _, decoder, decoded, taps = sensor
    decoder = decoder.with_suffix(ending)
    if ending == ".onnx":  # PyTorch is not asked for
        monkeypatch.setattr("bgmodel.tactile.decoder.import_torch", None)
    camera = tmp_path / "camera"
    camera.mkdir()
    yaw = taps.labels["yaw_deg"].to_numpy()
    first, second = (taps.labels["image"][np.abs(yaw - at).argmin()] for at in (0.0, STEP_DEG))
    blank = tmp_path / "blank.png"
    blank.write_bytes(b"nothing")
    thread = arriving(camera, [first] * 10 + [blank] + [second] * 10)
    out = tmp_path / "decisions.csv"
    asked = ["--decoder", decoder, "--taps", decoded, "--mm-per-px", MM_PER_PX, *who]
    asked += ["--task", "edge-direction", f"step_deg={STEP_DEG}", "--idle-s", 1.5]
    assert run("touch", "watch", camera, "--save", out, *asked) == 0
    thread.join()
    decisions = read_table(out)
    assert len(decisions) >= 4
    assert str(decisions["choice"].iloc[0]) == "0"
    assert str(decisions["choice"].iloc[-1]) == f"{STEP_DEG:g}"
    assert decisions["readings"].sum() <= 20
    told = capsys.readouterr()
    assert "decisions on 20 readings" in told.out
    assert "not a readable image: this image is skipped" in told.err


def test_a_table_of_another_decoder_is_refused(sensor, tmp_path, capsys):
    _, decoder, _, taps = sensor
    images, table = taps.labels["image"][0].parent.parent, tmp_path / "own.parquet"
    asked = ["--edge", "--mm-per-px", MM_PER_PX]
    other = tmp_path / "other.safetensors"
    train(taps, seed=2, training=replace(EDGE, epochs=1)).save(other)
    assert run("touch", "decode", other, images, "--save", table, *asked) == 0
    (tmp_path / "camera").mkdir()
    watch = ["touch", "watch", tmp_path / "camera", "--save", tmp_path / "o.csv", "--taps", table]
    watch += ["--decoder", decoder, "--mm-per-px", MM_PER_PX, "--idle-s", 0.1]
    assert run(*watch) == 2
    assert "was decoded by another decoder" in capsys.readouterr().err


def test_another_scale_than_that_of_the_training_is_doubted(sensor, tmp_path):
    _, decoder, decoded, _ = sensor
    trained = replace(Decoder.load(decoder), about={"taps": {"mm_per_px": MM_PER_PX}})
    path, few = tmp_path / "edge.safetensors", write(tmp_path / "few", [draw(hexagon())] * 3)
    trained.save(path)
    (tmp_path / "camera").mkdir()
    decode = ["decode", path, few, "--edge", "--save", tmp_path / "few.csv", "--force"]
    watch = ["watch", tmp_path / "camera", "--by", "test", "--idle-s", 0.1]
    watch += ["--decoder", path, "--taps", decoded]
    for asked in (decode, watch):
        for scale, doubts in ((MM_PER_PX, 0), (1.05 * MM_PER_PX, 1)):
            warned = told(run, "touch", *asked, "--mm-per-px", scale)
            assert sum("mm_per_px must be 0.2" in each for each in warned) == doubts
    assert run("touch", *decode) == 0  # at the scale of the training
    assert not told(trained.decode, few)
    assert told(trained.decode, few, mm_per_px=0.21)
    assert not told(Decoder.load(decoder).decode, few, mm_per_px=0.21)  # its scale is unknown


@pytest.mark.parametrize("blank", [(), (2,), (3,)])
def test_an_unreadable_image_takes_the_other_one_of_its_pair_with_it(blank, sensor, tmp_path):
    """Five pairs of one direction each: paired with the next image, one would seem to turn."""
    folder, decoder, _, taps = sensor
    decoded, true = tmp_path / "decoded.csv", np.repeat(np.arange(-180, 180), 2)
    read = true + 25 * np.random.default_rng(3).normal(size=720)
    pd.DataFrame({"yaw_deg": true, "edge_deg": read}).to_csv(decoded, index=False)
    images = [taps.labels["image"][k] for k in (0, 0, 90, 90, 180, 180, 270, 270, 45, 45)]
    for place in blank:
        images[place] = tmp_path / "blank.png"
        images[place].write_bytes(b"nothing")
    skipped: list[str] = []
    watched = Watched(folder=folder, decoder=decoder, taps=decoded, mm_per_px=MM_PER_PX, model=None,
                      task=EdgeTurn(2, STEP_DEG), skipped=skipped.append)  # fmt: skip
    readings = [nats for nats in map(watched._reader(), images) if nats is not None]
    assert len(readings) == 5 - len(blank)
    assert all(same > turned for same, turned in readings)
    assert all("skipped, and so is the other one of its pair" in each for each in skipped)
    assert len(skipped) == len(blank)


def test_images_come_in_the_order_of_their_time_and_once_they_are_whole(tmp_path):
    for name in ("b.png", "a.png", "notes.txt"):
        (tmp_path / name).write_bytes(b"x")
        time.sleep(0.02)
    (tmp_path / "empty.png").touch()
    assert [path.name for path in images(tmp_path, 0.3)] == ["b.png", "a.png"]


def test_images_that_are_there_already_are_listed_twice_and_not_once_for_each(
    tmp_path, monkeypatch
):
    """A folder with thousands of images takes long to list: a session must not fall behind."""
    listed = []
    real = os.listdir
    monkeypatch.setattr(os, "listdir", lambda path: listed.append(path) or real(path))
    for number in range(200):
        (tmp_path / f"{number:03d}.png").write_bytes(b"x")
    paths = images(tmp_path, 0.2)
    assert [next(paths).name for _ in range(200)] == [f"{n:03d}.png" for n in range(200)]
    assert len(listed) == 2


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"task": "orientation"}, "needs a decoder of taps of a grating"),
        ({"engine": "algebra"}, "takes all readings of a trial at once"),
        ({"posterior": 0.99}, "resolves no OUT below"),
    ],
)
def test_bad_input_gets_one_clear_sentence(changes, says, sensor, tmp_path, capsys):
    _, decoder, decoded, _ = sensor
    asked = {"decoder": decoder, "taps": decoded, "mm_per_px": MM_PER_PX, "idle_s": 0.1}
    (tmp_path / "camera").mkdir()
    asked = {"folder": tmp_path / "camera", "save": tmp_path / "out.csv"} | asked | changes
    options = [part for k, v in asked.items() for part in (f"--{k.replace('_', '-')}", v)]
    assert run("touch", "watch", *options[1:]) == 2
    assert says in capsys.readouterr().err
