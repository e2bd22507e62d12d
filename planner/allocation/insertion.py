"""How much more a robot's path is worth with one task more, for all tasks and all places in the path at once.

The worth of a path is the time-discounted reward of Choi, Brunet, How (2009), section V, less fuel:
S(p) = sum_j v_j exp(-rate tau_j) - fuel * (seconds on the way), tau_j the arrival at task j. A task inserted
at a place delays all that come after it by the same time, so their worth shrinks by one common factor: each
place costs one multiplication per task, and the exponentials of all legs are taken beforehand.
"""

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.kernels import exact_kernel

_TINY = 1e-250  # below it, what is worth being delayed is nothing


@exact_kernel
def insertion_gains(
    path: IntArray,
    length: int,
    value: FloatArray,
    first: FloatArray,
    leg: FloatArray,
    leg_to: FloatArray,
    duration: FloatArray,
    first_e: FloatArray,
    leg_e: FloatArray,
    leg_to_e: FloatArray,
    duration_e: FloatArray,
    fuel: float,
    limit: float,
    home: FloatArray,
    gains: FloatArray,
    places: IntArray,
) -> None:
    """Best gain of each of t tasks and its place (the first of equals), into `gains` and `places`.

    Args:
        path: tasks in the order of their execution, the first `length` of the array.
        value: (t,) rewards at arrival time 0; -inf where the robot cannot do a task.
        first: (t,) seconds from the robot's start; `leg[a, b]` seconds from task a to b; `leg_to` = `leg.T`.
        duration: (t,) seconds that a task takes.
        first_e, leg_e, leg_to_e, duration_e: exp(-rate * ...) of these.
        fuel: what a second on the way costs.
        limit: seconds after which the robot must be done, the way home included.
        home: (t,) seconds from each task to there.
        gains: (t,), -inf where a task cannot be added; without meaning for tasks in the path.
        places: (t,) of the insertion, 0 for the front.
    """
    t = value.size
    weight = np.empty(length + 1)  # discount at the departure before each place
    depart = np.empty(length + 1)
    tail = np.zeros(length + 1)  # worth of all from a place on
    weight[0], depart[0] = 1.0, 0.0
    for n in range(length):
        b = path[n]
        arrival = weight[n] * (first_e[b] if n == 0 else leg_e[path[n - 1], b])
        tail[n] = value[b] * arrival
        weight[n + 1] = arrival * duration_e[b]
        depart[n + 1] = depart[n] + (first[b] if n == 0 else leg[path[n - 1], b]) + duration[b]
    for n in range(length - 1, -1, -1):
        tail[n] += tail[n + 1]
    total = depart[length] + (home[path[length - 1]] if length > 0 else 0.0)
    timed = fuel > 0.0 or limit < np.inf
    gain = np.empty(t)
    gains[:] = -np.inf
    places[:] = 0
    for n in range(length + 1):
        row_e = first_e if n == 0 else leg_e[path[n - 1]]
        row = first if n == 0 else leg[path[n - 1]]
        if n == length:
            _discounted(gain, weight[n], row_e, value)
            if timed:
                _less_fuel_at_end(gain, fuel, limit, depart[n], row, duration, home)
        else:
            b = path[n]
            delayed = tail[n] / row_e[b] if row_e[b] > _TINY else 0.0
            _inserted(gain, weight[n], row_e, value, delayed, duration_e, leg_to_e[b], tail[n])
            if timed:
                _less_fuel(gain, fuel, limit, total, row, leg_to[b], row[b], duration)
        _keep_best(gain, n, gains, places)


@exact_kernel
def _discounted(gain: FloatArray, here: float, row_e: FloatArray, value: FloatArray) -> None:
    """At the path's end."""
    for j in range(gain.size):
        gain[j] = here * row_e[j] * value[j]


@exact_kernel
def _inserted(
    gain: FloatArray,
    here: float,
    row_e: FloatArray,
    value: FloatArray,
    delayed: float,
    duration_e: FloatArray,
    to_e: FloatArray,
    after: float,
) -> None:
    """Before the tasks that are worth `after`, and delayed * (discount of the way to them over j) then."""
    for j in range(gain.size):
        gain[j] = row_e[j] * (here * value[j] + delayed * (duration_e[j] * to_e[j])) - after


@exact_kernel
def _less_fuel_at_end(
    gain: FloatArray,
    fuel: float,
    limit: float,
    departure: float,
    row: FloatArray,
    duration: FloatArray,
    home: FloatArray,
) -> None:
    """Less the fuel of the way there; -inf where it is too late to be home in time."""
    for j in range(gain.size):
        done = departure + row[j] + duration[j] + home[j]
        gain[j] = gain[j] - fuel * row[j] if done <= limit else -np.inf


@exact_kernel
def _less_fuel(
    gain: FloatArray,
    fuel: float,
    limit: float,
    total: float,
    row: FloatArray,
    to: FloatArray,
    direct: float,
    duration: FloatArray,
) -> None:
    """Less the fuel of the way round; -inf where the path, `total` seconds so far, would take too long."""
    for j in range(gain.size):
        extra = row[j] + to[j] - direct
        gain[j] = gain[j] - fuel * extra if total + extra + duration[j] <= limit else -np.inf


@exact_kernel
def _keep_best(gain: FloatArray, place: int, gains: FloatArray, places: IntArray) -> None:
    for j in range(gain.size):
        better = gain[j] > gains[j]
        gains[j] = gain[j] if better else gains[j]
        places[j] = place if better else places[j]
