"""Reads a mixture from a JSON file that anyone can write."""

import json
from pathlib import Path
from typing import Final

from safety.risk.model.mixture import Mixture, MixtureError

_TOLD: Final = 40
"""Characters of what is no number."""
FORM: Final = """\
{"weights":        [w, …],             K numbers, together one
 "means_mm":       [[x, y, z], …],     K rows
 "factors_per_mm": [[[a, b, c],        K upper triangular matrices Ū,
                     [0, d, e],        the inverse covariance is ŪᵀŪ
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
        for name in names:
            if (strange := _no_number(content[name])) is not None:
                raise MixtureError(f"{name}: {strange} is no number")
        return Mixture.checked(*(content[name] for name in names))
    except OSError as error:
        raise MixtureError(f"{path}: {error.strerror}") from None
    except RecursionError:
        raise MixtureError(f"{path}: brackets within brackets, too deep to be read") from None
    except ValueError as error:  # no UTF-8, no JSON, an integer of thousands of digits, no mixture
        raise MixtureError(f"{path}: {error}") from None


def _no_number(part: object) -> str | None:
    """What in lists of lists of numbers is neither; None: nothing."""
    if isinstance(part, list):
        return next((found for one in part if (found := _no_number(one)) is not None), None)
    if isinstance(part, int | float) and not isinstance(part, bool):
        return None
    return json.dumps(part)[:_TOLD]
