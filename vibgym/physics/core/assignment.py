"""Linear assignment: a different column for each row at the least total cost."""

from __future__ import annotations

import math

from vibgym.kernels.jit import jit


@jit
def assign(cost, potential_row, potential_column, row_of, way, least, used, column_of):
    """Assign each row to a different column at the least total cost (H. W. Kuhn 1955; augmenting shortest paths).

    Args:
        cost: (rows, columns), rows <= columns.
        potential_row: (rows + 1,) and potential_column, way, row_of, least, used: (columns + 1,), scratch.
        column_of: (rows,) written.
    """
    rows, columns = cost.shape
    potential_row[:] = 0.0
    potential_column[:] = 0.0
    row_of[:] = 0
    way[:] = 0
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
