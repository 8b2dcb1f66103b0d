"""A cache of compiled code that belongs to these very sources.

Numba looks at the file of a compiled function alone, not at those that it takes others from.
"""

import hashlib
import os
from pathlib import Path

ROOT = Path(__file__).parents[1]
SOURCES = [ROOT / "bgmodel" / "crossing.py", *sorted((ROOT / "circuits").glob("*.py"))]
STATE = hashlib.sha256(b"".join(path.read_bytes() for path in SOURCES)).hexdigest()[:16]
os.environ.setdefault("NUMBA_CACHE_DIR", str(ROOT / ".pytest_cache" / "numba" / STATE))
