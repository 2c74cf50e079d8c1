"""A Kalman filter of three values and their rates: constant velocity, white acceleration.

The three are alike and know nothing of each other, so one covariance of value and rate, two by
two, speaks for all of them. In plain floats: on matrices this small, an array library would spend
most of a control step on its own overhead.
"""

from collections.abc import Sequence

Triple = tuple[float, float, float]

_ZERO: Triple = (0.0, 0.0, 0.0)


class ConstantVelocity:
    """The values are measured, the rates follow from them. Time passes in `advance`."""

    def __init__(self, noise_variance: float, acceleration_variance: float) -> None:
        """noise_variance: of a measured value. acceleration_variance: constant over a step."""
        self.values = _ZERO
        self.rates = _ZERO
        self._noise = noise_variance
        self._acceleration = acceleration_variance
        # Covariance of each value and its rate.
        self._of_value, self._of_both, self._of_rate = noise_variance, 0.0, 0.0

    def begin(self, values: Sequence[float], rate_variance: float) -> None:
        """Forget the past: values that were just measured, with rates that are not known."""
        x, y, z = values
        self.values, self.rates = (x, y, z), _ZERO
        self._of_value, self._of_both, self._of_rate = self._noise, 0.0, rate_variance

    def ahead(self, ahead_s: float) -> Triple:
        """The values, extrapolated."""
        (x, y, z), (u, v, w) = self.values, self.rates
        return x + ahead_s * u, y + ahead_s * v, z + ahead_s * w

    def variance(self, ahead_s: float) -> float:
        """Of one value, extrapolated."""
        known = self._of_value + 2.0 * ahead_s * self._of_both + ahead_s**2 * self._of_rate
        return known + 0.25 * ahead_s**4 * self._acceleration

    def surprise(self, innovation: Triple, ahead_s: float) -> float:
        """Squared Mahalanobis distance of measured values, this long after the state.

        innovation: by how much they differ from what was extrapolated.
        """
        x, y, z = innovation
        return (x * x + y * y + z * z) / (self.variance(ahead_s) + self._noise)

    def advance(self, dt_s: float) -> None:
        """Predict `dt_s` ahead: P becomes F P Fᵀ + σ² g gᵀ, with g = (dt²/2, dt)."""
        self.values = self.ahead(dt_s)
        self._of_value = self.variance(dt_s)
        self._of_both += dt_s * self._of_rate + 0.5 * dt_s**3 * self._acceleration
        self._of_rate += dt_s**2 * self._acceleration

    def correct(self, innovation: Triple) -> None:
        """Take measured values of this moment. innovation: by how much they differ from ours."""
        all_in_all = self._of_value + self._noise
        gain, rate_gain = self._of_value / all_in_all, self._of_both / all_in_all
        (x, y, z), (u, v, w), (a, b, c) = self.values, self.rates, innovation
        self.values = (x + gain * a, y + gain * b, z + gain * c)
        self.rates = (u + rate_gain * a, v + rate_gain * b, w + rate_gain * c)
        self._of_rate -= rate_gain * self._of_both
        self._of_both *= self._noise / all_in_all
        self._of_value = gain * self._noise
