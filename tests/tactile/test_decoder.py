"""The decoder: reproducible, stored safely, and clear about what it can't use."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from bgmodel.cli import run
from bgmodel.tactile.decoder import EDGE, Decoder, Training, _epoch, _fit, train
from bgmodel.tactile.networks import NETWORKS, EdgeNetwork, GratingNetwork, wrapped
from bgmodel.tactile.taps import Taps
from circuits.errors import InputError
from tests.helpers import refused
from tests.tactile.striped import QUICK, pushed_taps, striped_taps

ABOUT = {"taps": "striped"}


@pytest.fixture(scope="module")
def decoder():
    return train(striped_taps(1200), seed=3, training=QUICK, about=ABOUT)


def test_a_decoder_reads_the_angle_of_unseen_taps(decoder):
    fresh = striped_taps(300, seed=2)
    yaw = fresh.labels["yaw_deg"].to_numpy()
    error = np.abs(wrapped(decoder.decode(fresh)["orientation_deg"] - yaw, 180)).mean()
    assert error < 15  # 45 by chance
    shuffled = np.abs(wrapped(decoder.decode(fresh)["orientation_deg"] - yaw[::-1], 180)).mean()
    assert shuffled > 30


def test_the_same_seed_gives_the_same_weights(decoder, tmp_path):
    again = train(striped_taps(1200), seed=3, training=QUICK, about=ABOUT, device="cpu")
    first, second = decoder.save(tmp_path / "a.safetensors"), again.save(tmp_path / "b.safetensors")
    assert first.read_bytes() == second.read_bytes()
    other = train(striped_taps(1200), seed=4, training=QUICK).save(tmp_path / "c.safetensors")
    assert first.read_bytes() != other.read_bytes()


def test_networks_trained_in_threads_are_those_trained_alone_and_leave_the_global_numbers():
    import torch

    def weights(seed):
        brief = replace(EDGE, epochs=1, width=0.1, batch=32)
        tensors = train(pushed_taps(150, 1), seed=seed, training=brief).network.state_dict()
        return [each.numpy().tobytes() for each in tensors.values()]

    alone = [weights(seed) for seed in (1, 2)]
    before = torch.get_rng_state()
    with ThreadPoolExecutor(2) as threads:
        assert list(threads.map(weights, (1, 2))) == alone
    assert torch.equal(torch.get_rng_state(), before)


@pytest.mark.parametrize("name", ["grating", "edge"])
def test_training_stays_on_the_device_of_the_network(name, monkeypatch):
    """The device "meta" computes no values and refuses operands on other devices."""
    import torch

    kind = NETWORKS[name]
    zeros = np.zeros((8, len(kind.weights)))
    monkeypatch.setattr(torch.Tensor, "item", lambda self: 1.0)
    monkeypatch.setattr("bgmodel.tactile.decoder._outputs", lambda *_: zeros)
    network = kind.build(kind.shape(5), 0.1, 1.0).to("meta")
    inputs, yaw = np.zeros((8, *kind.shape(5)), dtype=np.float32), np.zeros(8)
    _fit(network, replace(QUICK, network=name, batch=4), inputs, yaw, inputs, yaw)
    assert {str(value.device) for value in network.state_dict().values()} == {"meta"}


@pytest.mark.parametrize("device", ["cuda", "mps", "abacus"])
def test_a_device_that_pytorch_does_not_find_is_refused(device, monkeypatch, tmp_path):
    """Before taps are read."""
    import torch

    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    monkeypatch.setattr(torch.backends.mps, "is_available", lambda: False)
    with refused(r"device must be one that PyTorch finds here \(cpu\)"):
        train(striped_taps(), seed=3, training=QUICK, device=device)
    absent, decoder = str(tmp_path / "absent.npz"), str(tmp_path / "d.onnx")
    with pytest.raises(InputError, match="device"):
        run(["touch", "train", absent, "--save", decoder, "--device", device])


def test_a_stored_decoder_is_the_decoder(decoder, tmp_path):
    back = Decoder.load(decoder.save(tmp_path / "d.safetensors"))
    taps = striped_taps(50, seed=2)
    assert np.array_equal(back.decode(taps)["psi_deg"], decoder.decode(taps)["psi_deg"])
    assert back.training == QUICK
    assert back.about["seed"] == 3
    assert back.about["taps"] == "striped"
    assert not list(tmp_path.glob(".*"))


def test_edges_are_read_in_all_directions():
    edge = train(pushed_taps(1500, 1), seed=1, training=EDGE)
    fresh = pushed_taps(300, 2)
    error = wrapped(edge.decode(fresh)["edge_deg"] - fresh.labels["yaw_deg"].to_numpy(), 360)
    assert error.std() < 15


def test_a_decoder_refuses_taps_of_what_it_was_not_trained_on(decoder, tmp_path):
    gratings = striped_taps(300)
    of_edges = replace(gratings, stimulus="edge")
    back = Decoder.load(decoder.save(tmp_path / "d.safetensors"))
    for one in (decoder, back):
        with refused("taps one stimulus, grating"):
            one.decode(of_edges)
    with refused("taps one stimulus, edge"):
        train(gratings, seed=1, training=EDGE)
    with refused("taps one stimulus, grating"):
        train(of_edges, seed=1, training=QUICK)
    with refused("training must be a Training of"):
        train(gratings, seed=1, training={"epochs": 2})
    for taps in (gratings, of_edges):
        taps.save(tmp_path / "t.npz", {})
        assert Taps.load(tmp_path / "t.npz")[0].stimulus == taps.stimulus
        assert taps.select(np.arange(3)).stimulus == taps.stimulus
    with refused("stimulus"):
        replace(gratings, stimulus="leaf")


def test_pins_within_a_thousandth_of_a_millimetre_are_those_it_was_trained_on(decoder):
    taps = striped_taps(5, seed=2)
    near, beyond = (replace(taps, rest_mm=taps.rest_mm + s) for s in (0.0009, 0.00115))
    known = decoder.decode(taps)["psi_deg"]
    np.testing.assert_array_equal(decoder.decode(near)["psi_deg"], known)
    with refused("taps got taps of 361 pins"):
        decoder.decode(beyond)


def loss_of(kind, hidden=(), l2=0.0, which=0):
    """Return the loss of outputs that err by 1 in one of them, behind other layers."""
    import torch

    outputs = len(kind.weights)
    last = torch.nn.Linear(2, outputs)
    last.weight.data.zero_()
    last.bias.data = torch.eye(outputs)[which]
    network = torch.nn.Sequential(*hidden, last)
    optimiser = torch.optim.SGD(network.parameters(), 0.0)
    schedule = torch.optim.lr_scheduler.ConstantLR(optimiser, 1.0)
    x, y = torch.ones(20, 2), torch.zeros(20, outputs)
    return _epoch(network, Training(l2=l2, batch=5), kind, x, y, optimiser, schedule)


def test_the_label_counts_ten_times_as_much_as_cosine_and_sine_which_count_alike():
    """Cosine and sine of an edge count alike too: no direction is worth more than another."""
    label, cosine, sine = (loss_of(GratingNetwork, which=k) for k in range(3))
    assert label == pytest.approx(10 * cosine)
    assert cosine == pytest.approx(sine)
    assert cosine == pytest.approx(1 / 3)
    assert [loss_of(EdgeNetwork, which=k) for k in range(2)] == pytest.approx([1 / 2, 1 / 2])


@pytest.mark.parametrize(
    ("errors", "passes", "best"),
    [
        ([5, 3, 4, 4, 4, 1], 5, 2),
        ([5, 3, 4, 4, 2, 4], 6, 5),
        ([5, 4, 3, 3, 3, 3], 6, 6),
        ([5, 6, 6, 4, 9, 9], 6, 4),
    ],
)
def test_training_ends_after_its_patience_and_keeps_the_best_pass(
    monkeypatch, errors, passes, best
):
    """Three passes without a smaller error; of equal ones the last is kept."""
    import torch

    network, told = GratingNetwork.build((19, 19), 0.1, 0.0), iter(errors)
    errors_of = staticmethod(lambda *_: {"mae_deg": float(next(told))})
    monkeypatch.setattr(GratingNetwork, "errors", errors_of)

    def epoch(network, *_):
        with torch.no_grad():
            network[-1].bias += 1
        return 0.0

    monkeypatch.setattr("bgmodel.tactile.decoder._epoch", epoch)
    network[-1].bias.data.zero_()
    maps, yaw = striped_taps(8).maps(), np.zeros(8)
    training = replace(QUICK, epochs=6, patience=3)
    history = _fit(network, training, maps, yaw, maps, yaw)
    assert [row["mae_deg"] for row in history] == errors[:passes]
    assert network[-1].bias.tolist() == [best] * 3


def test_mirror_images_keep_the_truth():
    taps = striped_taps(4)
    yaw = taps.labels["yaw_deg"].to_numpy()
    maps, yaws = GratingNetwork.augmented(taps.maps(), yaw)
    assert len(maps) == len(yaws) == 16
    order = np.lexsort((-taps.rest_mm[:, 0], -taps.rest_mm[:, 1]))
    mirrored = replace(taps, displacement_mm=taps.displacement_mm[:, order])
    assert np.allclose(mirrored.maps(), maps[8:12], atol=1e-5)
    assert yaws[8:12] == pytest.approx(-yaw)


def test_bad_files_get_one_clear_sentence(decoder, tmp_path):
    contents = decoder.save(tmp_path / "d.safetensors").read_bytes()
    bad = {
        "cut": contents[: len(contents) // 2],
        "text": b"not a decoder",
        "empty": b"",
        "width": contents.replace(b'\\"width\\": 0.1', b'\\"width\\": 0.2'),
    }
    assert bad["width"] != contents
    for name, content in bad.items():
        path = tmp_path / f"{name}.safetensors"
        path.write_bytes(content)
        with refused("path does not hold a decoder"):
            Decoder.load(path)
    with refused("path there is no decoder"):
        Decoder.load(tmp_path / "absent.safetensors")
    other = path.rename(tmp_path / "decoder.pt")
    for use in (decoder.save, Decoder.load):
        with refused("path must end in .safetensors or .onnx"):
            use(other)


def unknown(taps):
    return replace(taps, displacement_mm=np.full_like(taps.displacement_mm, np.nan))


def test_bad_input_gets_one_clear_sentence(decoder):
    around = replace(striped_taps(100, limit=200), stimulus="edge")
    for call, says in (
        (lambda: decoder.decode(striped_taps(9, layout="circular")), "taps got taps of 331 pins"),
        (lambda: decoder.decode(unknown(striped_taps(9))), "taps finite displacements"),
        (lambda: train(striped_taps(40), seed=1), "taps at least 128 taps"),
        (lambda: train(striped_taps(limit=180), seed=1), "yaw_deg"),
        (lambda: train(around, seed=1, training=EDGE), "yaw_deg"),
    ):
        with refused(says):
            call()
