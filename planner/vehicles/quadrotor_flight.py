"""The quadrotor's motion, four at a time: one kernel that prediction and simulation share.

A single flight is a chain of square roots and divisions that each wait for the one before. LANES flights side
by side fill that waiting and the width of the processor: a prediction is three times faster than one by one.
Operations are exact (no fast mathematics) and every flight sees the same ones in the same order, whatever its
lane, its company and the cutting into calls: predicted and flown ways agree to the last bit.
"""

import math

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.kernels import exact_kernel
from planner.vehicles.prediction import grown
from planner.vehicles.quadrotor_lqr import GRAVITY

APPROACH = 2.0  # 1/s: the last metres of the reference, where sqrt(2 a d) would be infinitely steep
LANES = 4
STATES = 18  # the paper's position, angles, velocity, rates (3 each), then the reference's position, velocity
WAYPOINT, COST, TOLERANCE, ROWS = 18, 21, 22, 23  # what else a lane holds, and how many numbers in all


@exact_kernel
def fly(lanes: FloatArray, n: FloatArray, most: int) -> int:
    """Advance all lanes (ROWS, LANES) in place by `most` control periods; fewer if one arrives before.

    A lane's rows: state, waypoint, control cost so far (sum of u^T u in N^2 and (N m)^2, (MA)ASI (18)), and
    the square of the tolerance, negative if arriving does not matter. `n` is `Quadrotor._numbers`.
    Returns the periods done.
    """
    t, kp, ka, kv, kr, lag = n[0], n[1], n[2], n[3], n[4], n[5]
    cp, cv, climb_lag, tp, tr = n[6], n[7], n[8], n[9], n[10]
    ix2, iy2, iz2, m2 = n[11] ** 2, n[12] ** 2, n[13] ** 2, n[14] ** 2
    speed, acceleration = n[15], n[16]
    near = acceleration / (APPROACH * APPROACH)  # where the two laws of approach meet, with equal slope
    change = acceleration * t
    gt, gt2, gt3, gt4 = GRAVITY * t, GRAVITY * t**2 / 2, GRAVITY * t**3 / 6, GRAVITY * t**4 / 24
    t2 = t**2 / 2
    a = lanes.ravel()  # constant strides, so that the compiler sees that rows do not overlap
    for done in range(most):
        arrived = 0
        for i in range(LANES):
            x, y, z = a[i], a[LANES + i], a[2 * LANES + i]
            roll, pitch, yaw = a[3 * LANES + i], a[4 * LANES + i], a[5 * LANES + i]
            vx, vy, vz = a[6 * LANES + i], a[7 * LANES + i], a[8 * LANES + i]
            p, q, r = a[9 * LANES + i], a[10 * LANES + i], a[11 * LANES + i]
            rx, ry, rz = a[12 * LANES + i], a[13 * LANES + i], a[14 * LANES + i]
            cx, cy, cz = a[15 * LANES + i], a[16 * LANES + i], a[17 * LANES + i]
            wx, wy, wz = a[18 * LANES + i], a[19 * LANES + i], a[20 * LANES + i]
            # The reference: towards the waypoint as fast as still lets it stop there, within the limits.
            dx, dy, dz = wx - rx, wy - ry, wz - rz
            gap = max(math.sqrt(dx * dx + dy * dy + dz * dz), 1e-12)
            braking = math.sqrt(2.0 * acceleration * max(gap - 0.5 * near, 0.0))
            scale = min(speed, braking if gap > near else APPROACH * gap) / gap
            dx, dy, dz = dx * scale - cx, dy * scale - cy, dz * scale - cz
            share = change / max(math.sqrt(dx * dx + dy * dy + dz * dz), change)
            cx, cy, cz = cx + dx * share, cy + dy * share, cz + dz * share
            rx, ry, rz = rx + cx * t, ry + cy * t, rz + cz * t
            # The LQR about it. Behind it by the lag is where a drone in steady flight belongs.
            ux = -kp * (x - rx + lag * cx) - ka * pitch - kv * (vx - cx) - kr * q
            uy = kp * (y - ry + lag * cy) - ka * roll + kv * (vy - cy) - kr * p
            uz = -cp * (z - rz + climb_lag * cz) - cv * (vz - cz)
            ut = -tp * yaw - tr * r
            x, vx = x + t * vx + gt2 * pitch + gt3 * q + gt4 * ux, vx + gt * pitch + gt2 * q + gt3 * ux
            y, vy = y + t * vy - gt2 * roll - gt3 * p - gt4 * uy, vy - gt * roll - gt2 * p - gt3 * uy
            z, vz = z + t * vz + t2 * uz, vz + t * uz
            pitch, q = pitch + t * q + t2 * ux, q + t * ux
            roll, p = roll + t * p + t2 * uy, p + t * uy
            yaw, r = yaw + t * r + t2 * ut, r + t * ut
            a[i], a[LANES + i], a[2 * LANES + i] = x, y, z
            a[3 * LANES + i], a[4 * LANES + i], a[5 * LANES + i] = roll, pitch, yaw
            a[6 * LANES + i], a[7 * LANES + i], a[8 * LANES + i] = vx, vy, vz
            a[9 * LANES + i], a[10 * LANES + i], a[11 * LANES + i] = p, q, r
            a[12 * LANES + i], a[13 * LANES + i], a[14 * LANES + i] = rx, ry, rz
            a[15 * LANES + i], a[16 * LANES + i], a[17 * LANES + i] = cx, cy, cz
            a[21 * LANES + i] += ix2 * uy * uy + iy2 * ux * ux + iz2 * ut * ut + m2 * uz * uz
            square = (x - wx) ** 2 + (y - wy) ** 2 + (z - wz) ** 2
            arrived |= square <= a[22 * LANES + i]
        if arrived:
            return done + 1
    return most


@exact_kernel
def predict(
    start: FloatArray, waypoints: FloatArray, n: FloatArray, bounds: IntArray, every: int
) -> tuple[IntArray, FloatArray, IntArray, FloatArray, FloatArray]:
    """Fly from `start` (18,) to each waypoint (w, 3), noting the pose every `every` steps from the first.

    Returns:
        steps (w,), control costs (w,), offsets (w + 1,) into the noted poses (total, 4), end states (w, 18).
    """
    w = waypoints.shape[0]
    steps, notes = np.zeros(w, dtype=np.int64), np.zeros(w, dtype=np.int64)
    costs, ends = np.zeros(w), np.empty((w, STATES))
    noted, owner, rank = np.empty((64, 4)), np.empty((64, 1)), np.empty((64, 1))
    row = 0
    lanes = np.zeros((ROWS, LANES))
    flying = np.full(LANES, -1)  # the waypoint that each lane is on its way to
    upcoming = 0
    tolerance2 = n[17] ** 2
    while True:
        chunk = -1
        for i in range(LANES):
            if flying[i] < 0:
                lanes[TOLERANCE, i] = -1.0
                while upcoming < w and flying[i] < 0:
                    gap = 0.0
                    for axis in range(3):
                        gap += (start[axis] - waypoints[upcoming, axis]) ** 2
                    if gap > tolerance2 and bounds[upcoming] > 0:
                        flying[i] = upcoming
                        lanes[:STATES, i] = start
                        lanes[WAYPOINT : WAYPOINT + 3, i] = waypoints[upcoming]
                        lanes[COST, i] = 0.0
                        lanes[TOLERANCE, i] = tolerance2
                    else:
                        ends[upcoming] = start
                    upcoming += 1
            goal = flying[i]
            if goal < 0:
                continue
            if steps[goal] == notes[goal] * every:
                if row == noted.shape[0]:
                    noted, owner, rank = grown(noted), grown(owner), grown(rank)
                noted[row, 0], noted[row, 1], noted[row, 2] = lanes[0, i], lanes[1, i], lanes[2, i]
                noted[row, 3] = lanes[5, i]
                owner[row, 0], rank[row, 0] = goal, notes[goal]
                notes[goal] += 1
                row += 1
            left = min(notes[goal] * every, bounds[goal]) - steps[goal]
            chunk = left if chunk < 0 else min(chunk, left)
        if chunk < 0:
            break
        done = fly(lanes, n, chunk)
        for i in range(LANES):
            goal = flying[i]
            if goal < 0:
                continue
            steps[goal] += done
            gap = 0.0
            for axis in range(3):
                gap += (lanes[axis, i] - lanes[WAYPOINT + axis, i]) ** 2
            if gap <= tolerance2 or steps[goal] >= bounds[goal]:
                costs[goal] = lanes[COST, i]
                ends[goal] = lanes[:STATES, i]
                flying[i] = -1
    offsets = np.zeros(w + 1, dtype=np.int64)
    offsets[1:] = np.cumsum(notes)
    poses = np.empty((row, 4))
    for k in range(row):
        poses[offsets[int(owner[k, 0])] + int(rank[k, 0])] = noted[k]
    return steps, costs, offsets, poses, ends
