"""The criterion of a circuit: its gain, OUT at rest, and the thresholds at which it can decide."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from bgmodel.deciding.readout import ReadOut
from bgmodel.support.arrays import Array
from circuits.engines import Algebra
from circuits.errors import InputError

if TYPE_CHECKING:
    from circuits.circuit import Circuit


def gain_of(circuit: Circuit, given: float | None = None) -> float:
    """Return the given gain, or by default that of the circuit, 1 for an exact circuit.

    Parameters
    ----------
    circuit : Circuit
        The table.
    given : float, optional
        The user's gain.

    Raises
    ------
    ValueError
        If none is given and the circuit has no default.
    """
    found = circuit.default_gain if given is None else given
    if found is None and (circuit.unedited or circuit).exact:
        return 1.0  # the output of an exact table is -ln P at any gain
    if found is None:
        raise InputError(
            f"{circuit.name} has no default gain: give gain=... (at the terminal --gain), the "
            f"circuit's {circuit.unit} per nat of evidence",
            "gain",
        )
    return found


def rest_out(circuit: Circuit) -> float:
    """Return the lowest OUT at the fixed point of rest; infinity if it has none.

    Time courses of the input begin with the drive and are left out.
    """
    try:
        silence = np.zeros((1, 1, circuit.channels))
        found = Algebra().run(circuit.steady, silence, step_ms=1.0).output_nats.min()
    except ValueError:
        return np.inf  # Without a resting state there is nothing to compare with.
    return float(found)


def check_threshold(circuit: Circuit, threshold_nats: float) -> None:
    """Refuse a threshold that OUT is past before any evidence, or can never reach.

    Parameters
    ----------
    circuit : Circuit
        The table.
    threshold_nats : float
        OUT at which it decides, in the circuit's unit.

    Raises
    ------
    ValueError
        If the threshold is refused; the message states OUT at rest.
    """
    readout_of(circuit).check(threshold_nats)


@lru_cache(maxsize=1024)
def readout_of(circuit: Circuit) -> ReadOut:
    """Return the meaning of thresholds on a circuit's OUT: where it rests, how low it can go."""
    return ReadOut(circuit.name, circuit.readable_nats[0], rest_out(circuit), circuit.unit)


def check_conditions(
    control: Circuit, control_nats: float, manipulated: Circuit, manipulated_nats: float
) -> None:
    """Refuse the thresholds of a control and a manipulation, as ``check_threshold`` does.

    A manipulated circuit that rests below its threshold is a valid outcome: it decides without
    evidence. A threshold beyond the range of its read-out is refused.

    Parameters
    ----------
    control, manipulated : Circuit
        The circuit before and after a manipulation.
    control_nats, manipulated_nats : float
        OUT at which each decides.

    Raises
    ------
    ValueError
        If the control would decide without evidence, or a circuit can never reach its threshold.
    """
    check_threshold(control, control_nats)
    if manipulated_nats < manipulated.readable_nats[0]:
        check_threshold(manipulated, manipulated_nats)


def deciding_thresholds(circuit: Circuit, thresholds_nats: Array) -> Array:
    """Return the thresholds that are below OUT at rest and within reach of the read-out."""
    low = circuit.readable_nats[0]
    return thresholds_nats[(thresholds_nats >= low) & (thresholds_nats < rest_out(circuit))]
