"""Files of experiments."""

import tomllib

import tomlkit
from hypothesis import strategies as st

from tests.strategies import filled
from tests.strategies.edits import MANIPULATION, WRONG_MANIPULATIONS

FILE = f"""
name = "«a lesion|x»"
published = "«faster|»"
source = "nobody"
note = "«a test|two\\nlines»"
engine = "algebra"
seed = «0|3|123456»
posterior = «0.8|0.7»
foreperiod_ms = «100.0|50»
gain = «0.5|1»
«truth = 1|»
task = {{trials = 240, t_max = 6..8, d_prime = 2.0}}
control = {{}}
manipulation = {{{MANIPULATION}}}
[[predictions]]
measure = "«accuracy|mean_ms|missed»"
direction = "«up|down|none»"
at_least = 0.01..0.4
"""
WRONG = f"""
seed = «"three"|1.5|true»
posterior = «1.0|95|"0.9"»
foreperiod_ms = «0|inf»
engine = "spiking"
gains = 1
name = 3
published = 2026-01-01
truth = 7
task = {{«trials = 0|trials = 1e13|conflict = 1.0|channels = 1|period_mm = 2.5|size = 3»}}
manipulation = {{«{WRONG_MANIPULATIONS}|posterior = 2»}}
control = {{edits = ["neurons x"]}}
predictions = [{{«measure = "speed"|direction = "left"|at_least = «-1|nan»»}}]
"""
"""Keys with values that are refused."""


def files():
    """Return files that are right, as dictionaries."""
    return filled(FILE).map(tomllib.loads)


@st.composite
def wrong_files(draw):
    """Draw the text of a file with one thing wrong, in its syntax or its meaning."""
    file = draw(files())
    broken = draw(st.sampled_from(["= 3\n", "name = 'open\n", "[task\n", "", "", "no measure"]))
    if broken == "no measure":
        del file["predictions"][0]["measure"]
        return tomlkit.dumps(file)
    wrong = draw(filled(draw(st.sampled_from(WRONG.strip().split("\n")))))
    ((key, value),) = tomllib.loads(wrong).items()
    if key == "predictions":
        value = [file[key][0] | value[0]]
    elif isinstance(value, dict):
        value = file[key] | value
    return broken + tomlkit.dumps(file | {key: value})
