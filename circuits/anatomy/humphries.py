"""The circuit of Humphries, Stewart & Gurney 2006: spiking action selection, linear shunting."""

from __future__ import annotations

from math import exp, log
from typing import NamedTuple

from circuits.cells import Lif, Phase, Rate
from circuits.checks import check_channels, check_range
from circuits.circuit import Circuit
from circuits.declaration.rows import GABA, GLUTAMATE, Population, Projection, rows

HUMPHRIES = "Humphries et al. 2006"
CODE = f"{HUMPHRIES}, ModelDB 83559"
CELL = f"{CODE}; line fitted"
SALIENCE = f"{CODE}; 40 Hz per 1 assumed"
SLOW = f"NMDA, {CODE}; cell means"
AMPA = f"AMPA, {CODE}; gates as at rest"
NMDA = f"NMDA, {CODE}; gates as at rest"
DISTAL = f"GABA, distal, {CODE}; gates as at rest"
CLAMP = f"GABA near the soma, {CODE}; no gates"
BOTH = f"GABA, {CODE}; gates as at rest"

HZ = 100.0  # rate at an activity of 1, as in gpr
SALIENCE_HZ = 40.0  # rate added by a salience of 1
TONIC_HZ, PALLIDAL_HZ = 3.0, 30.0  # tonic rates of cortex, and of GPe and SNr ("30-30-12")
SYNAPSES = 16.0  # a quarter of the 64 cells of a nucleus; over all channels if diffuse
PSP_MV, NMDA_PSP_MV = 3.0, 0.1
AMPA_MS, NMDA_MS, GABA_MS = 2.0, 100.0, 3.0
CLAMP_MV = -20.0  # potential to which shunting drives a cell, relative to rest
HEIGHT = 0.5  # inhibition that closes a gate, in units of one spike of each synapse

# Noise is 0.3 mV per 0.1 ms step; rest_mv and mv_per_nat are from fit_current, 100 Hz per unit.
# fmt: off
#         tau_ms  noise_mv  threshold_mv  reset_mv  refractory_ms  rest_mv  mv_per_nat
MSN = Lif(25,     3.361,    30,           0,        2,             20.58,   70.06)
STN = Lif(6,      1.657,    20,           0,        2,             14.94,   11.22)
GPE = Lif(14,     2.519,    30,           0,        2,             20.88,   42.37)
SNR = Lif(8,      1.909,    30,           0,        2,             24.34,   17.37)
# fmt: on


def psp_area(peak_mv: float, synapse_ms: float, membrane_ms: float) -> float:
    """Return the area of a postsynaptic potential, mV ms, from its peak.

    The authors look for the peak no later than one membrane time constant after the spike; slow
    currents peak later.
    """
    late_ms = log(synapse_ms / membrane_ms) / (1 / membrane_ms - 1 / synapse_ms)
    peak_ms = min(late_ms, membrane_ms)
    shape = exp(-peak_ms / synapse_ms) - exp(-peak_ms / membrane_ms)
    return peak_mv * (synapse_ms - membrane_ms) / shape


class Target(NamedTuple):
    """The target of a synapse: its cell and its inhibition at rest."""

    cell: Lif
    intrinsic_mv: float  # potential without synaptic input: intrinsic current times resistance
    proximal_hz: float = 0.0  # spikes per second arriving at proximal synapses at rest
    somatic_hz: float = 0.0  # the same at somatic synapses

    @property
    def bias(self) -> float:
        """The intrinsic current, as a bias on the cell's fitted line, nats."""
        return (self.intrinsic_mv - self.cell.rest_mv) / self.cell.mv_per_nat

    @property
    def closed_s(self) -> float:
        """Fraction of a gate closed per proximal or somatic spike per second, s.

        Scaled for GPe, the median over nuclei: 13.36 synapses of either kind.
        """
        here = psp_area(PSP_MV, GABA_MS, self.cell.tau_ms) / self.cell.tau_ms
        of_gpe = psp_area(PSP_MV, GABA_MS, GPE.tau_ms) / GPE.tau_ms
        return 1e-3 * GABA_MS * here / (HEIGHT * 13.36 * of_gpe)

    @property
    def gate(self) -> float:
        """Fraction of excitation and of distal inhibition that passes the gates at rest."""
        return (1 - self.closed_s * self.proximal_hz) * (1 - self.closed_s * self.somatic_hz)

    def excited(self, peak_mv: float, synapse_ms: float) -> float:
        """Return the weight of glutamatergic synapses, from the peak of one EPSP."""
        area = self.gate * psp_area(peak_mv, synapse_ms, self.cell.tau_ms)
        return SYNAPSES * 1e-3 * area * HZ / self.cell.mv_per_nat

    def inhibited(self, distal: float) -> float:
        """Return the (negative) weight of GABAergic synapses, a fraction ``distal`` of them distal.

        The others inject the clamping current, ``clamp - intrinsic``, scaled by the mean gate.
        """
        area = self.gate * psp_area(PSP_MV, GABA_MS, self.cell.tau_ms)
        clamp_mv = (self.intrinsic_mv - CLAMP_MV) * self.closed_s / 2
        mv_per_hz = distal * 1e-3 * area + (1 - distal) * clamp_mv
        return -SYNAPSES * mv_per_hz * HZ / self.cell.mv_per_nat


def humphries(channels: int = 2, *, dopamine: float = 0.3) -> Circuit:
    """Return the spiking circuit of Humphries, Stewart & Gurney 2006.

    Saliences of 0 to 1 raise the rate of cortical Poisson spikes from 3 to 43 Hz; the output of
    each channel is the rate of its 64 SNr cells, in units of 100 Hz, not a posterior. The authors
    call a channel selected when that rate is below 5 Hz, 0.05 here. Cells, synapses, delays,
    connections and intrinsic currents are those of the authors' code (ModelDB 83559); weights
    follow from the peaks of its postsynaptic potentials. The 40 Hz per unit of salience and the 50
    ms read-out filter are assumed. The lines used by the ``rate`` and ``algebra`` engines are
    fitted to single cells, so their resting rates differ from those of the spiking circuit.

    Shunting inhibition is linearised. In the original, inhibition near the soma injects a current
    that clamps the cell, which is additive and is kept, and closes two gates for all input that
    arrives further out; here the gates are fixed at the values set by the tonic rates of the code,
    30 Hz in GPe and SNr. Also left out are the lowest potential of -20 mV, the rebound current of
    STN, which needs -10 mV, and the skew of STN's time constants; instead all constants of a cell
    vary by the 10 % that the code gives tau and R. NMDA currents come from the mean over cells, as
    separate populations. Connections have a fixed in-degree and may include autapses.

    Dopamine is lambda, 0..1: cortical weights are ``1 + lambda`` onto D1, ``1 - lambda`` onto D2
    and ``1 - lambda / 4`` onto STN; those of D2 and STN onto GPe, and of GPe onto STN, ``1 - lambda
    / 2``. ``Circuit.dopamine`` changes only cortical weights onto D1 and D2.
    """
    check_channels(channels)
    check_range(0, 1, dopamine=dopamine)
    half = 1 - 0.5 * dopamine
    of_gpe = half * SYNAPSES * PALLIDAL_HZ  # GPe spikes per second that reach an STN cell
    mutual = SYNAPSES * PALLIDAL_HZ / 2  # half of them proximal, half somatic
    msn = Target(MSN, -10.5)
    stn = Target(STN, 19.8, 0.4 * of_gpe, 0.3 * of_gpe)
    gpe = Target(GPE, 33.44, mutual, mutual)
    snr = Target(SNR, 43.68, 2 * mutual, 2 * mutual)
    gpe_stn, d2_gpe = stn.inhibited(0.3), gpe.inhibited(0.33)
    d1, d2, stn_ = 1 + dopamine, 1 - dopamine, 1 - 0.25 * dopamine
    nuclei = msn, stn, gpe, snr
    fast_msn, fast_stn, fast_gpe, fast_snr = (to.excited(PSP_MV, AMPA_MS) for to in nuclei)
    slow_msn, slow_stn, slow_gpe, slow_snr = (to.excited(NMDA_PSP_MV, NMDA_MS) for to in nuclei)
    n, within, all_n = channels, 0.25, 0.25 / channels
    tonic, of_ctx = TONIC_HZ / SALIENCE_HZ, SALIENCE_HZ / HZ
    # fmt: off
    populations = rows(Population, (
        "name        cell        neurons gain_hz_per_nat transmitter bias_nats heterogeneity cite",
        ("ctx",      Phase(1.0), 64,     SALIENCE_HZ,    GLUTAMATE,  tonic,    0.0,   SALIENCE),
        ("ctx_NMDA", Rate(),     1,      HZ,             GLUTAMATE,  0.0,      0.0,   SLOW),
        ("D1",       MSN,        64,     HZ,             GABA,       msn.bias, 0.1,   CELL),
        ("D2",       MSN,        64,     HZ,             GABA,       msn.bias, 0.1,   CELL),
        ("STN",      STN,        64,     HZ,             GLUTAMATE,  stn.bias, 0.1,   CELL),
        ("STN_NMDA", Rate(),     1,      HZ,             GLUTAMATE,  0.0,      0.0,   SLOW),
        ("GPe",      GPE,        64,     HZ,             GABA,       gpe.bias, 0.1,   CELL),
        ("SNr",      SNR,        64,     HZ,             GABA,       snr.bias, 0.1,   CELL),
    ), (
        "name        transfer     tau_ms   receptor",
        ("ctx",      "rectified", 0.0,     ""),
        ("ctx_NMDA", "linear",    NMDA_MS, ""),
        ("D1",       "linear",    0.0,     "D1"),
        ("D2",       "linear",    0.0,     "D2"),
        ("STN_NMDA", "linear",    NMDA_MS, ""),
    ))
    projections = rows(Projection, (
        "source      target      weight                    pattern    delay_ms probability cite",
        ("ctx",      "ctx_NMDA", of_ctx,                   "channel", 0.0,     1,          SLOW),
        ("ctx",      "D1",       of_ctx * d1 * fast_msn,   "channel", 10,      within,     AMPA),
        ("ctx",      "D2",       of_ctx * d2 * fast_msn,   "channel", 10,      within,     AMPA),
        ("ctx",      "STN",      of_ctx * stn_ * fast_stn, "channel", 2.5,     within,     AMPA),
        ("ctx_NMDA", "D1",       d1 * slow_msn,            "channel", 10,      1,          NMDA),
        ("ctx_NMDA", "D2",       d2 * slow_msn,            "channel", 10,      1,          NMDA),
        ("ctx_NMDA", "STN",      stn_ * slow_stn,          "channel", 2.5,     1,          NMDA),
        ("D1",       "SNr",      4 * snr.inhibited(1),     "channel", 4,       within,     DISTAL),
        ("D2",       "GPe",      4 * half * d2_gpe,        "channel", 5,       within,     BOTH),
        ("STN",      "STN_NMDA", 1,                        "channel", 0.0,     1,          SLOW),
        ("STN",      "GPe",      half * fast_gpe / n,      "diffuse", 2,       all_n,      AMPA),
        ("STN",      "SNr",      fast_snr / n,             "diffuse", 1.5,     all_n,      AMPA),
        ("STN_NMDA", "GPe",      half * slow_gpe / n,      "diffuse", 2,       1,          NMDA),
        ("STN_NMDA", "SNr",      slow_snr / n,             "diffuse", 1.5,     1,          NMDA),
        ("GPe",      "STN",      half * gpe_stn,           "channel", 4,       within,     BOTH),
        ("GPe",      "SNr",      snr.inhibited(0),         "channel", 3,       within,     CLAMP),
        ("GPe",      "GPe",      gpe.inhibited(0) / n,     "diffuse", 1,       all_n,      CLAMP),
        ("SNr",      "SNr",      snr.inhibited(0) / n,     "diffuse", 1,       all_n,      CLAMP),
    ), (
        "source      target tau_ms",
        ("ctx",      "D1",  AMPA_MS),
        ("ctx",      "D2",  AMPA_MS),
        ("ctx",      "STN", AMPA_MS),
        ("D1",       "SNr", GABA_MS),
        ("D2",       "GPe", GABA_MS),
        ("STN",      "GPe", AMPA_MS),
        ("STN",      "SNr", AMPA_MS),
        ("GPe",      "STN", GABA_MS),
        ("GPe",      "SNr", GABA_MS),
        ("GPe",      "GPe", GABA_MS),
        ("SNr",      "SNr", GABA_MS),
    ), (
        "source      target receptor",
        ("ctx_NMDA", "D1",  "D1"),
        ("ctx_NMDA", "D2",  "D2"),
    ))
    # fmt: on
    return Circuit(
        name="humphries",
        populations=populations,
        projections=projections,
        channels=channels,
        unit="salience",
        reference_nats=0.0,
        readout_tau_ms=50.0,
        range_nats=(-float("inf"), 1.0),
        most_channels=16,  # beyond, a cell would get less than one synapse from each other channel
        about=f"spiking cells select the channel of the largest salience; {HUMPHRIES}",
    )
