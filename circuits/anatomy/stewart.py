"""The circuit of Stewart, Choo & Eliasmith 2010: GPR's weights in spikes, with synaptic lags."""

from __future__ import annotations

from circuits.cells import Phase, Rate
from circuits.checks import check_channels, check_range
from circuits.circuit import Circuit
from circuits.declaration.rows import GABA, GLUTAMATE, Population, Projection, rows

STEWART = "Stewart et al. 2010"
CODE = f"{STEWART}, nengo 4.1"
SALIENCE = f"{CODE}, no cells"
CELLS = f"{CODE}; regular cells assumed"
AMPA = f"AMPA 2 ms, {CODE}"
GABA_A = f"GABA 8 ms, {CODE}"

AMPA_MS, GABA_MS = 2.0, 8.0
HZ = 200.0  # maximal rates of 200 to 400 Hz at an input of 1.5


def stewart(channels: int = 2, *, dopamine: float = 0.2) -> Circuit:
    """Return the spiking circuit of Stewart, Choo & Eliasmith 2010, as ``nengo`` ships it.

    Weights and thresholds are those of ``gpr``, as is dopamine. All lags are synaptic, 2 ms from
    STN and 8 ms from GABAergic cells; the input has none. Inputs are saliences, 0..1; the output of
    each channel is the value that SNr represents, near 0 if the channel is selected, not a
    posterior. The authors' functions have no upper limit; their ensembles represent up to 1.5.

    Cell heterogeneity is left out: in the original, each nucleus has 100 leaky integrate-and-fire
    cells per channel with random thresholds and slopes, and decoders that combine them into the
    line. Here the cells are identical and regular, and each follows the line itself: 200 Hz per
    unit, the mean of the authors' maximal rates divided by 1.5. There are therefore no decoding
    errors. The 10 ms read-out filter is that of nengo's tests.
    """
    check_channels(channels)
    check_range(0, 1, dopamine=dopamine)
    cell = Phase(0.0)
    from_code = f"no synapse, {CODE}"
    d1, d2 = 1 + dopamine, 1 - dopamine
    # fmt: off
    populations = rows(Population, (
        "name   cell    neurons gain_hz_per_nat transmitter receptor transfer     bias_nats cite",
        ("ctx", Rate(), 1,      HZ,             GLUTAMATE,  "",      "rectified", 0.0,   SALIENCE),
        ("D1",  cell,   100,    HZ,             GABA,       "D1",    "rectified", -0.2,  CELLS),
        ("D2",  cell,   100,    HZ,             GABA,       "D2",    "rectified", -0.2,  CELLS),
        ("STN", cell,   100,    HZ,             GLUTAMATE,  "",      "rectified", 0.25,  CELLS),
        ("GPe", cell,   100,    HZ,             GABA,       "",      "rectified", 0.2,   CELLS),
        ("SNr", cell,   100,    HZ,             GABA,       "",      "rectified", 0.2,   CELLS),
    ))
    projections = rows(Projection, (
        "source target weight pattern    tau_ms   cite",
        ("ctx", "D1",  d1,    "channel", 0.0,     from_code),
        ("ctx", "D2",  d2,    "channel", 0.0,     from_code),
        ("ctx", "STN", 1,     "channel", 0.0,     from_code),
        ("D1",  "SNr", -1,    "channel", GABA_MS, GABA_A),
        ("D2",  "GPe", -1,    "channel", GABA_MS, GABA_A),
        ("STN", "GPe", 0.9,   "diffuse", AMPA_MS, AMPA),
        ("STN", "SNr", 0.9,   "diffuse", AMPA_MS, AMPA),
        ("GPe", "STN", -1,    "channel", GABA_MS, GABA_A),
        ("GPe", "SNr", -0.3,  "channel", GABA_MS, GABA_A),
    ))
    # fmt: on
    return Circuit(
        name="stewart",
        populations=populations,
        projections=projections,
        channels=channels,
        unit="salience",
        reference_nats=0.0,
        readout_tau_ms=10.0,
        range_nats=(-float("inf"), 1.0),
        about=f"spikes select the channel of the largest salience; {STEWART}",
    )
