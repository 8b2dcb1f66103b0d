"""What users do most, each in at most three lines after ``import bgmodel as bg``."""

import numpy as np
import pandas as pd
import pytest

import bgmodel as bg
from bgmodel.support.seeds import stream

EVIDENCE = "evidence = bg.gaussian_evidence(150, d_prime=1.0, t_max=30, seed=1)"
MODEL = 'model = bg.BasalGanglia("macaque", seed=1)'
TASKS = {
    "load a circuit": 'result = bg.load_circuit("macaque")["STN->GPe"]',
    "show it": 'result = "STN" in str(bg.load_circuit("macaque"))',
    "edit it": """
circuit = bg.load_circuit("macaque")
by_verbs = circuit.lesion("STN", 0.1).cut("GPe", "STN", 0.5).dopamine(0.9)
result = by_verbs == circuit.edited("lesion STN 10%", "cut GPe->STN 50%", "dopamine 0.9")""",
    "make evidence": EVIDENCE + "\nresult = evidence.trials",
    "read evidence": 'result = bg.read_evidence("evidence.csv", step_ms=50.0).hypotheses',
    "run it": f"""
{EVIDENCE}
rates = bg.BasalGanglia("macaque", seed=1).activity(evidence[:5]).to_xarray().rate_hz
result = rates.sel(nucleus="STN", channel=0).mean() > 0""",
    "decide": f"{EVIDENCE}\n{MODEL}\nresult = model.decide(evidence, posterior=0.82).accuracy",
    "accuracy and RTs as a table": f"""
{EVIDENCE}
{MODEL}
result = model.decide(evidence, posterior=0.82).to_dataframe()[["correct", "time_ms"]]""",
    "compare with the MSPRT": f"""
{EVIDENCE}
{MODEL}
result = bg.compare(model, evidence, accuracies=0.85, resamples=100).summary()""",
    "run an experiment": 'result = bg.Experiment.from_toml("lesion.toml").run().summary()',
    "run a sweep to xarray": 'result = bg.Sweep.from_toml("grid.toml").run().to_xarray().accuracy',
    "fit a table of trials": """
fitted = bg.fit("trials.csv", "constant_gap", strength="coherence")
result = fitted.summary()""",
    "plot": f"{EVIDENCE}\n{MODEL}\nresult = model.decide(evidence, posterior=0.82).plot()",
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Go to a folder with a table of evidence, one of trials, an experiment and a sweep."""
    monkeypatch.chdir(tmp_path)
    rng = stream(3, "twelve tasks")
    readings = pd.DataFrame(rng.normal(size=(40, 2)), columns=["ll_left", "ll_right"])
    readings = readings.assign(trial=np.repeat(np.arange(10), 4), step=[1, 2, 3, 4] * 10)
    readings.to_csv("evidence.csv", index=False)
    strength = np.repeat([0.05, 0.2, 0.6], 100)
    correct = rng.random(300) < 1 / (1 + np.exp(-8 * strength))
    rt = 0.3 + rng.gamma(3, 0.15, 300)
    trials = {"coherence": strength, "response": correct.astype(int), "rt": rt}
    pd.DataFrame(trials).to_csv("trials.csv", index=False)
    task = "[task]\ntrials = 120\nt_max = 30\nd_prime = 1.0\n"
    about = 'name = "lesion"\nnote = "its size is assumed"\ncircuit = "macaque"\n'
    (tmp_path / "lesion.toml").write_text(f'{about}{task}[manipulation]\nedits = ["lesion STN 5%"]')
    (tmp_path / "grid.toml").write_text(
        f'circuit = "macaque"\n{task}[grid]\n"lesion STN" = [0, 0.05]'
    )


@pytest.mark.parametrize("name", TASKS)
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_it_takes_at_most_three_lines(name, folder):
    code = TASKS[name].strip()
    assert len(code.splitlines()) <= 3
    names = {"bg": bg}
    exec(code, names)
    result = names["result"]
    assert result is not None
    if isinstance(result, pd.DataFrame):
        assert len(result)
    elif isinstance(result, (bool, np.bool_)):
        assert result
