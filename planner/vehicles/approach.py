"""How vehicles that can stop come to their waypoints: the speed from which one still stops there.

Beyond ρ₀ = a / k² metres it is √(2 a (ρ - ρ₀ / 2)), a constant deceleration a, and k ρ nearer, which is
exponential; the two meet with equal slope. k ρ alone would brake too hard from far away, √(2 a ρ) alone is
infinitely steep at the waypoint.
"""

import math

from estimator.kernels import exact_kernel


@exact_kernel
def stoppable(gap: float, deceleration: float, rate: float) -> float:
    """Speed in m/s at `gap` metres, for a deceleration in m/s^2 and a rate k in 1/s."""
    near = deceleration / (rate * rate)
    if gap <= near:
        return rate * gap
    return math.sqrt(2.0 * deceleration * (gap - 0.5 * near))
