"""One linear inverse controller on each receptive field, learnt from a window of samples.

Ho 2018, §2.4 and Algorithm 1, with the printed equations corrected. In field i, Δu = x βᵢ with
x = [Δp, p, u, 1]; βᵢ comes from reward-weighted regression over the window (equations 10–13),
and the controllers' answers are blended by the fields' weights (equation 5).

Three engines say the same: `OracleControllers` is to be read and compared with, `BatchControllers`
computes every field from every sample at each change, `BankControllers` keeps sums up to date.

In field i, with w_k the field's weight of sample k and C_k the sample's cost:

    σ²  = κ Σ w_k / Σ w_k C_k                           (11; other rules in `reward`)
    W_k = w_k exp(−½ σ² C_k)                            (10)
    A   = M Σ W_k x_kᵀx_k / Σ W_k + ρ Ā,   M = Σ w_k    (13; Ā, ρ: what pre-training knows)
    B   = M Σ W_k x_kᵀy_k / Σ W_k + ρ B̄
    β   = (A + ridge (M + ρ) I')⁻¹ B                    (I': no ridge on the bias)

The reward only chooses among samples: how much the window counts against pre-training is Σ w.
"""

from collections.abc import Iterable
from typing import NamedTuple, Protocol

from daemon.learning.inverse.window import Window
from daemon.learning.samples.motion import MotionSample
from daemon.learning.samples.receptive_fields import ReceptiveFields
from drivers.pose import Vector


class InverseAnswer(NamedTuple):
    """What the local controllers propose."""

    delta_u: Vector
    """(m,) Δu, mm or rad. Zero where nothing is known: see support."""
    activation: float
    """Largest weight of a field here: 1 in a field's centre, 0 far from all of them."""
    support: float
    """1/h: how many samples carry this answer, pre-training's included. 0: none does.

    With A the field's weighted sum of squares, h = x A⁻¹ xᵀ is the leverage of the query: noise of
    variance s² in the samples' Δu becomes h s² in the answer. At the middle of M samples 1/h is M,
    at a typical one of them M/P, since P parameters share them, and outside it falls with the
    square of the distance in units of their spread: in place, and in direction and length of the
    wanted Δp. Below a tenth of M/P the answer is extrapolation, whatever M is; where noise is
    known, h says how much of it gets through. Blended fields share their samples, so their
    leverages are averaged as if nothing averaged out.
    """


class LocalControllers(Protocol):
    """An engine. Nothing here raises for a query: one that is not finite has support 0."""

    @property
    def fields(self) -> ReceptiveFields: ...

    @property
    def window(self) -> Window:
        """The samples. To be read only."""
        ...

    @property
    def posture(self) -> Vector:
        """(m,) u₀ that the null space is drawn to."""
        ...

    @property
    def parameters(self) -> Vector:
        """(f, P, m) β by field in the paper's order [Δp, p − c, u − c, 1], in scaled units.

        Δp counts in tip_step_mm, places in the fields' scale from the field's centre, Δu in
        axis_steps. Zero where a field knows nothing. Solves what is not solved yet.
        """
        ...

    def add(self, sample: MotionSample) -> None:
        """Take a sample in; the oldest leaves. Raises ValueError, and nothing changes then."""
        ...

    def refill(self, samples: Iterable[MotionSample]) -> None:
        """Forget the window and take `samples`, oldest first. Raises ValueError.

        The state afterwards depends on nothing but the samples: who saves them, refills from them
        and goes on does exactly the same as who loads them.
        """
        ...

    def set_posture(self, posture: Vector) -> None:
        """Draw to another posture. Raises ValueError.

        The costs of all samples change, pre-training's included: tens of milliseconds for
        thousands of them, so not a thing to do in every step.
        """
        ...

    def solve(self, budget: int | None = None) -> None:
        """Work that can wait: solve `budget` of the fields that have changed, or all."""
        ...

    def command(self, delta_tip_mm: Vector, tip_mm: Vector, u: Vector) -> InverseAnswer:
        """The step that should move the tip by (3,) Δp from (3,) p and (m,) u."""
        ...
