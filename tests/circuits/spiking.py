"""A small spiking circuit, cell types to put into it, and its spikes."""

from dataclasses import dataclass

import numpy as np

from circuits import anatomy
from circuits.cells import AdEx, BrianText, Cell
from circuits.cells.single import ONE, ZERO, choose, fused, single
from circuits.engines import run

SPIKING = ("spikes", "brian2", "plain")
NAMES = ("ctx", "D1", "STN", "GPe", "SNr")
BASE = anatomy.spiking_msprt(2).with_neurons(40)
# Brette & Gerstner 2005, table 1, over a leak of 30 nS; current and noise so that it fires as GPe.
ADEX = AdEx(
    tau_ms=9.37,
    noise_mv=4,
    knee_mv=-50.4,
    sharpness_mv=2,
    peak_mv=20,
    reset_mv=-70.6,
    refractory_ms=1,
    rest_mv=-52,
    mv_per_nat=13.56,
    tau_w_ms=144,
    adaptation=4 / 30,
    jump_mv=80.5 / 30,
    leak_mv=-70.6,
)
DRIVE = np.zeros((2, 2, 2))
DRIVE[0, :, 0] = DRIVE[1, :, 1] = np.array([0, 1.4])
DRIVE -= DRIVE.mean(axis=2, keepdims=True)
GIVEN = {"step_ms": 25.0, "seed": 3, "settle_ms": 20.0}


FOUR = np.float32(4)


def begin_phase(uniform, noise_step, factor):
    return (single(uniform),)


def tick_phase(heard, ones, phi, noise_step, factor):
    width = noise_step * single(np.sqrt(heard))
    moved = phi + fused(width, ones, factor * single(heard) - FOUR * width)
    fired = moved >= ONE
    return fired, moved - choose(fired, ONE, ZERO)


@dataclass(frozen=True)
class Diffusing(Cell):
    """The diffusion whose passages ``Phase`` draws, tick by tick; tests register subclasses."""

    cv: float = 0.3
    state = ("phi",)
    begin = staticmethod(begin_phase)
    tick = staticmethod(tick_phase)
    brian = BrianText(
        tick="""
            width = single(noise_step*single(sqrt(hz*dt_s)))
            push = single(single(factor*single(hz*dt_s)) - 4*width)
            phi = single(phi + fused(width, ones(word, t_in_timesteps), push))
        """,
        spike="phi >= 1",
        reset="phi = phi - 1",
    )

    def constants(self, factors, dt_ms):
        noise_step = np.float32(self.cv * np.sqrt(factors[0] / 2))
        return {"noise_step": noise_step, "factor": np.float32(factors[0])}


def kind_of(base=Cell, name="Own", **given):
    """Return a cell type that a test makes from another one."""
    return dataclass(frozen=True)(type(name, (base,), {"__module__": __name__, **given}))


def spike_set(activity, *names):
    """Return the spikes of some nuclei, or of all that were recorded."""
    columns = ["trial", "channel", "neuron", "time_ms"]
    tables = {name: activity.spikes[name][columns].round(3) for name in names or activity.spikes}
    return {(name, *row) for name, t in tables.items() for row in t.itertuples(index=False)}


def spikes_of(circuit, engine):
    return spike_set(run(circuit, DRIVE, engine=engine, spikes=NAMES, **GIVEN))


def lacking(engine="spikes", **options):
    def call(circuit):
        options_of_engine = GIVEN if engine in SPIKING else {"step_ms": 40.0}
        return run(circuit, DRIVE[:, :1], engine=engine, **options_of_engine | options)

    return call
