"""Makes `small_world` importable by name: for the tests, and as "module:Class" localizer in their child processes."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
