"""Gas enclosed in a cylinder, a tube and a chamber of the body: isothermal, its amount fixed.

Amounts are pressure times volume, MPa·mm³. In balance p (V_cylinder + V_tube + A ℓ) = amount; the
tube throttles, so the share in the chamber follows its balanced value with the pneumatic lag.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from sim_backends.plants.plant import FloatArray

ATMOSPHERE_MPA = 0.101325


class GasLines(NamedTuple):
    """All lines over one step in time, their pistons where the step ends.

    amount: (m,) gas in each line. in_chamber: (m,) of it in the chamber when the step began.
    supply_mm3: (m,) cylinder and tube. area_mm2: (m,) of the chambers. kept: what is left at the
    end of the step of a difference at its beginning, exp(−dt/lag).
    """

    amount: FloatArray
    in_chamber: FloatArray
    supply_mm3: FloatArray
    area_mm2: FloatArray
    kept: float

    def chamber_pressure(self, length_mm: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Absolute pressure MPa in chambers of these lengths at the step's end, and dp/dℓ."""
        held = self.kept * self.in_chamber / (self.area_mm2 * length_mm)
        whole_mm3 = self.supply_mm3 + self.area_mm2 * length_mm
        shared = (1.0 - self.kept) * self.amount / whole_mm3
        return held + shared, -held / length_mm - shared * self.area_mm2 / whole_mm3

    def amount_in_chamber(self, length_mm: FloatArray) -> FloatArray:
        """(m,) gas in the chambers at the step's end."""
        amount: FloatArray = _amount_in_chamber(
            self.amount, self.in_chamber, self.supply_mm3, self.area_mm2, self.kept, length_mm
        )
        return amount

    def cylinder_pressure(self, in_chamber: FloatArray) -> FloatArray:
        """(m,) absolute pressure MPa in front of the pistons at the step's end, with so much gas
        in the chambers."""
        return (self.amount - in_chamber) / self.supply_mm3


@njit(cache=True, error_model="numpy")
def _amount_in_chamber(
    amount: FloatArray,
    in_chamber: FloatArray,
    supply_mm3: FloatArray,
    area_mm2: FloatArray,
    kept: float,
    length_mm: FloatArray,
) -> FloatArray:
    """(m,) pressure, as `GasLines.chamber_pressure` has it, times volume."""
    out = np.empty_like(amount)
    for i in range(out.shape[0]):
        area, length = area_mm2[i], length_mm[i]
        held = kept * in_chamber[i] / (area * length)
        shared = (1.0 - kept) * amount[i] / (supply_mm3[i] + area * length)
        out[i] = (held + shared) * area * length
    return out
