"""Regions to explore: the area cut in two again and again, the same way by every robot.

Where the cuts are depends on the ground alone, and never on what was seen: each goes through the middle of
the grid points of what it cuts, across its longer side. A region's name is its place among the cuts, so
robots that have seen different things mean the same place by the same name, whatever they have or have not
heard. What they have seen only decides how finely each part is cut: as long as it holds more than its share
of the unexplored mass. So regions are of the same mass up to a factor of two or so, and one that nobody
explores keeps its name until the others are so far explored that it is worth sharing out.
"""

from dataclasses import dataclass

import numpy as np

from estimator.arrays import BoolArray, FloatArray, IntArray

FINEST = 4  # cuts below the regions of equal size that there are at the start
SLACK = 2**0.5  # times its share that a region may hold before it is cut


@dataclass(frozen=True, slots=True, eq=False)
class Regions:
    """The cuts of one grid. Region 1 is all of it, and regions 2 i and 2 i + 1 are the halves of region i."""

    order: IntArray  # (n,) grid points such that each region's are next to each other
    depth: int  # how often it may be cut

    @staticmethod
    def of(points: FloatArray, regions: int, usable: BoolArray | None = None) -> "Regions":
        """Cut grid points, so that some `regions` of equal size can be made and some smaller ones.

        Args:
            points: (d, n).
            regions: at the start, at least 1.
            usable: (n,) points that belong to a region; default: all.

        Raises:
            ValueError: if `regions` is not positive.
        """
        if regions < 1:
            raise ValueError(f"regions: expected at least 1, got {regions}")
        order = np.arange(points.shape[1]) if usable is None else np.flatnonzero(usable)
        depth = int(np.ceil(np.log2(regions))) + FINEST
        parts = [(0, order.size)]
        for _ in range(depth):
            halves = []
            for low, high in parts:
                rows = order[low:high]
                if rows.size > 1:
                    own = points[:, rows]
                    axis = int(np.argmax(own.max(axis=1) - own.min(axis=1)))
                    order[low:high] = rows[np.lexsort((rows, own[axis]))]
                middle = (low + high) // 2
                halves += [(low, middle), (middle, high)]
            parts = halves
        return Regions(order, depth)

    def shares(self, weights: FloatArray, count: float) -> list[tuple[int, IntArray]]:
        """The regions that hold no more than 1.4 of `count` equal shares of the mass, and their grid points.

        Args:
            weights: (n,) mass of all grid points, finite and >= 0.
            count: of shares, positive.

        Returns:
            number and points, with mass only, of every region that has any, in the order of the cuts.
        """
        mass = np.concatenate([np.zeros(1), np.cumsum(weights[self.order])])
        most = SLACK * mass[-1] / count
        found = []
        waiting = [(1, 0, self.order.size, 0)]
        while waiting:
            number, low, high, cuts = waiting.pop()
            if mass[high] <= mass[low]:
                continue
            if mass[high] - mass[low] > most and cuts < self.depth and high - low > 1:
                middle = (low + high) // 2
                waiting.append((2 * number + 1, middle, high, cuts + 1))
                waiting.append((2 * number, low, middle, cuts + 1))
                continue
            rows = np.sort(self.order[low:high])
            rows = rows[weights[rows] > 0]
            if rows.size:
                found.append((number, rows))
        return found
