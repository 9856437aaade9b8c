"""temporary"""

import numpy as np

from irs_gym.grid import MOVES


class BudgetToGo:
    def __init__(self, tables, lengths):
        self.cost = tables
        self.lengths = lengths

    def distance(self, cells, left):
        cells = np.asarray(cells)
        left = np.asarray(left, dtype=float)
        ok = self.cost[:, cells] <= left
        first = ok.argmax(axis=0)
        return np.where(ok.any(axis=0), self.lengths[first], np.inf)

    def least_cost(self, cells):
        return self.cost[:, np.asarray(cells)].min(axis=0)


def budget_to_go(cost, goal, cell_size, most):
    X, Y = cost.shape
    K = 120
    S = np.full((X + 2, Y + 2), np.inf)
    c = np.full((X + 2, Y + 2), np.inf)
    c[1:-1, 1:-1] = cost
    start = S.copy()
    start[goal[0] + 1, goal[1] + 1] = 0.0
    layer = {(0, 0): start}
    out = [(0.0, start[1:-1, 1:-1].ravel())]
    even = [m for m in range(8) if m % 2 == 0]
    odd = [m for m in range(8) if m % 2]
    for k in range(1, K):
        new = {}
        for a in range(k + 1):
            b = k - a
            best = S.copy()
            for prev, ms in (((a - 1, b), even), ((a, b - 1), odd)):
                f = layer.get(prev)
                if f is None:
                    continue
                g = f + c
                for m in ms:
                    dx, dy = MOVES[m]
                    best[1:-1, 1:-1] = np.minimum(
                        best[1:-1, 1:-1], g[1 + dx : X + 1 + dx, 1 + dy : Y + 1 + dy]
                    )
            best[np.isinf(c)] = np.inf
            best[best > most] = np.inf
            if np.isfinite(best).any():
                new[a, b] = best
                out.append(((a + b * 2**0.5) * cell_size, best[1:-1, 1:-1].ravel()))
        layer = new
        if not new:
            break
    out.sort(key=lambda e: e[0])
    return BudgetToGo(np.array([o[1] for o in out]), np.array([o[0] for o in out]))
