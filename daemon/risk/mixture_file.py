"""Reads a mixture from a JSON file that anyone can write."""

import json
from pathlib import Path
from typing import Final

from safety.risk.mixture import Mixture, MixtureError

FORM: Final = """\
{"weights":            [w, …],                      K numbers, together one
 "means_mm":           [[x, y, z], …],              K rows
 "factors_per_mm":     [[[a, b, c],                 K upper triangular matrices Ū,
                         [0, d, e],                 the inverse covariance is ŪᵀŪ
                         [0, 0, f]], …]}
"""


def read_mixture(path: Path) -> Mixture:
    """The mixture in a file. Raises MixtureError, which names the file."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(content, dict):
            raise MixtureError(f"must be of this form:\n{FORM}")
        names = ("weights", "means_mm", "factors_per_mm")
        if missing := [name for name in names if name not in content]:
            raise MixtureError(f"{missing[0]} is missing. It must be of this form:\n{FORM}")
        return Mixture.checked(*(content[name] for name in names))
    except OSError as error:
        raise MixtureError(f"{path}: {error.strerror}") from None
    except (MixtureError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise MixtureError(f"{path}: {error}") from None
