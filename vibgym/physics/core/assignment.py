"""Linear assignment: a different column for each row at the least total cost."""

from __future__ import annotations

import math

import numpy as np

from vibgym.kernels.jit import jit


@jit(allocates=True)
def assign(cost, column_of):
    """Assign each row to a different column at the least total cost (H. W. Kuhn 1955; augmenting shortest paths).

    Args:
        cost: (rows, columns), rows <= columns.
        column_of: (rows,) written.
    """
    rows, columns = cost.shape
    potential_row, potential_column, least = np.zeros(rows + 1), np.zeros(columns + 1), np.empty(columns + 1)
    row_of, way = np.zeros(columns + 1, np.int64), np.zeros(columns + 1, np.int64)
    used = np.empty(columns + 1, np.bool_)
    for row in range(1, rows + 1):
        row_of[0] = row
        at = 0
        least[:] = math.inf
        used[:] = False
        while row_of[at] != 0:
            used[at] = True
            mine, delta, then = row_of[at], math.inf, 0
            for column in range(1, columns + 1):
                if not used[column]:
                    value = cost[mine - 1, column - 1] - potential_row[mine] - potential_column[column]
                    if value < least[column]:
                        least[column] = value
                        way[column] = at
                    if least[column] < delta:
                        delta = least[column]
                        then = column
            for column in range(columns + 1):
                if used[column]:
                    potential_row[row_of[column]] += delta
                    potential_column[column] -= delta
                else:
                    least[column] -= delta
            at = then
        while at != 0:
            before = way[at]
            row_of[at] = row_of[before]
            at = before
    for column in range(1, columns + 1):
        if row_of[column] > 0:
            column_of[row_of[column] - 1] = column - 1
