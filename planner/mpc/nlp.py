"""The two nonlinear programs of Liu & Hedrick (2017), (6), stated once to CasADi and solved by IPOPT.

States, covariances and controls of all steps are variables (multiple shooting), so that every derivative is
sparse. CasADi is the optional extra `mpc`.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from planner.mpc.model import Domain, Foreseen, Limits, Task, corrected, rolled_out

SMALL = 1e-4  # m^2: a target under the robot is in some direction
STAGE = 9  # variables of a step: turn rate, acceleration, x, y, yaw, speed, p_xx, p_xy, p_yy
MISSING = (
    "planner: kind 'mpc' needs CasADi, which is not installed; "
    "install it with the extra: pip install 'searchparty[mpc]'"
)
OPTIONS = {
    "print_time": False,
    "error_on_fail": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.max_iter": 40,
    "ipopt.tol": 1e-3,
    "ipopt.acceptable_tol": 1e-2,
    "ipopt.acceptable_iter": 3,
    "ipopt.mu_init": 1e-2,
    "ipopt.warm_start_init_point": "yes",
    "ipopt.mu_strategy": "monotone",
}


def casadi() -> Any:
    """The module.

    Raises:
        ValueError: if it is not installed; names the extra.
    """
    try:
        import casadi as module  # noqa: PLC0415
    except ImportError as error:
        raise ValueError(MISSING) from error
    return module


def gamma(module: Any, domain: Domain, gap2: Any, cosine: Any) -> Any:
    """(7) for CasADi: of a squared distance and the cosine of the angle off the heading, None for any."""
    near = domain.gain / (1.0 + domain.alpha_1 * gap2)
    if cosine is None or domain.edge == -np.inf:
        return near
    return near / (1.0 + module.exp(-domain.alpha_2 * (cosine - domain.edge)))


class Program:
    """(6) over `steps` steps, with gamma by the range alone (step one) or by (7) in full (step two).

    In step two the heading in gamma is that of the trajectory found before, as the paper has it, and the
    direction to the target is that from the positions that are sought; so yaw and gamma are not coupled.
    """

    def __init__(self, steps: int, domain: Domain, limits: Limits, angular: bool) -> None:
        ca = casadi()
        self.steps, self.domain, self.limits, self.angular = steps, domain, limits, angular
        self._over: Callable[[], bool] = lambda: False
        z = ca.SX.sym("z", STAGE, steps)
        given = ca.SX.sym("given", 17 + 3 * steps)
        start, covariance, noise, process = given[0:4], given[4:7], given[7:10], given[10:13]
        t, certainty, distance, standoff = given[13], given[14], given[15], given[16]
        targets = ca.reshape(given[17 : 17 + 2 * steps], 2, steps)
        headings = given[17 + 2 * steps :]
        objective, equations = 0, []
        x, p = start, covariance
        for k in range(steps):
            u, after, spread = z[0:2, k], z[2:6, k], z[6:9, k]
            along, middle = t * (x[3] + 0.5 * t * u[1]), x[2] + 0.5 * t * u[0]
            moved = [x[0] + along * ca.cos(middle), x[1] + along * ca.sin(middle)]
            moved += [x[2] + t * u[0], x[3] + t * u[1]]
            gap2 = ca.sumsqr(targets[:, k] - after[0:2])
            gap = targets[:, k] - after[0:2]
            along = ca.cos(headings[k]) * gap[0] + ca.sin(headings[k]) * gap[1]
            cosine = along / ca.sqrt(gap2 + SMALL)
            seen = gamma(ca, domain, gap2, cosine if angular else None)
            q = p + process
            equations += [after - ca.vertcat(*moved)]
            equations += [spread - ca.vertcat(*corrected(q[0], q[1], q[2], noise, seen))]
            middle = after[0:2] + standoff * ca.vertcat(ca.cos(after[2]), ca.sin(after[2]))
            away = ca.sumsqr(targets[:, k] - middle)
            objective += certainty * (spread[0] + spread[2]) + distance * away
            x, p = after, spread
        problem = {"x": ca.vec(z), "p": given, "f": objective, "g": ca.vertcat(*equations)}
        self._stop = _stopper(ca, self, STAGE * steps, 7 * steps)
        self._solver = ca.nlpsol("two_step", "ipopt", problem, {**OPTIONS, "iteration_callback": self._stop})
        self._multipliers = np.zeros(7 * steps)

    def __repr__(self) -> str:
        return f"Program({self.steps} steps, {'full' if self.angular else 'range only'})"

    def solve(self, task: Task, guess: Foreseen, over: Callable[[], bool]) -> tuple[Foreseen, str]:
        """The plan found, rolled out, and the solver's word for how it ended.

        Args:
            task: of as many steps as the program.
            guess: whence to begin; step two takes its headings.
            over: asked after every iteration whether to stop; what there is then is the answer.
        """
        n, limits = self.steps, self.limits
        v = float(task.state[3])
        low, high = np.full((n, STAGE), -np.inf), np.full((n, STAGE), np.inf)
        low[:, 0], high[:, 0] = -limits.turn_rate, limits.turn_rate
        low[:, 1], high[:, 1] = limits.braking, limits.accelerating
        low[:, 5], high[:, 5] = min(limits.slowest, v), task.ceilings(limits)
        low[:, 6] = low[:, 8] = 0.0
        first = np.hstack([guess.controls, guess.states[1:], guess.covariances])
        weights = np.array([task.step, task.certainty, task.distance, task.standoff])
        numbers = [task.state, task.covariance, task.noise, task.process, weights]
        given = np.concatenate([*numbers, task.targets.ravel(), guess.states[1:, 2]])
        self._over = over
        answer = self._solver(
            x0=first.ravel(), p=given, lbx=low.ravel(), ubx=high.ravel(), lbg=0.0, ubg=0.0,
            lam_g0=self._multipliers,
        )  # fmt: skip
        stats = self._solver.stats()
        found = np.asarray(answer["x"], dtype=np.float64).reshape(n, STAGE)
        multipliers = np.asarray(answer["lam_g"], dtype=np.float64).ravel()
        self._multipliers = multipliers if stats["success"] else np.zeros(7 * n)
        controls = np.where(np.isfinite(found[:, :2]), found[:, :2], guess.controls)
        return rolled_out(task, controls, self.domain, limits, True), str(stats["return_status"])


def _stopper(ca: Any, program: Program, variables: int, equations: int) -> Any:
    """IPOPT asks it after every iteration whether to stop."""
    sizes = {"f": 1, "x": variables, "lam_x": variables, "g": equations, "lam_g": equations}

    class Stop(ca.Callback):  # type: ignore[misc]
        def __init__(self) -> None:
            super().__init__()
            self.construct("stop", {})

        def get_n_in(self) -> int:
            return int(ca.nlpsol_n_out())

        def get_n_out(self) -> int:
            return 1

        def get_name_in(self, i: int) -> str:
            return str(ca.nlpsol_out(i))

        def get_sparsity_in(self, i: int) -> Any:
            size = sizes.get(ca.nlpsol_out(i), 0)
            return ca.Sparsity.dense(size, 1) if size else ca.Sparsity(0, 0)

        def eval(self, arg: Any) -> list[int]:
            return [int(program._over())]

    return Stop()
