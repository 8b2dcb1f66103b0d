"""The figure of a comparison shows the range in which accuracies vary."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from bgmodel.comparison.drawing import draw


def test_speed_and_accuracy_fill_their_axes_however_late_the_deadline():
    """Accuracy rises with a time constant of 100 and 200 ms, and is drawn up to a minute."""
    time_ms = np.geomspace(1, 60_000, 400)
    rows = []
    for name, tau_ms in (("MSPRT", 100.0), ("circuit", 200.0)):
        accuracy = 0.98 - 0.2 * np.exp(-time_ms / tau_ms)
        columns = {"mean_ms": time_ms, "accuracy": accuracy, "low": accuracy, "high": accuracy}
        rows.append(pd.DataFrame(columns).assign(model=name))
    row = {"model": "circuit", "reference": "MSPRT", "measure": "agreement", "accuracy": 0.9}
    table = pd.DataFrame([row | {"value": 0.9, "low": 0.8, "high": 1.0}])
    figure = draw(pd.concat(rows), pd.DataFrame({"accuracy": []}), table, 0.5)
    ax = figure.axes[0]
    # 98 % of the slower rise takes ln 50 time constants.
    assert 200 * np.log(50) < ax.get_xlim()[1] < 1.3 * 200 * np.log(50)
    low, high = ax.get_ylim()
    assert 0.7 < low < 0.78 < 0.98 < high < 1.0
    plt.close(figure)
