"""The shortest solution of three equations in many unknowns, where some of the equations may not be solvable."""

from __future__ import annotations

import math

from vibgym._numba.jit import borrowing

WEAKEST = 1e-12
"""Directions that the unknowns move less than 1e-6 as strongly as the best one (squared) count as out of reach."""

SOUND = 1e-6
"""Pivots above this share of the largest diagonal leave elimination ten digits; Newton's method needs a few."""

SWEEPS = 8
ROUNDING = 1e-18
"""Jacobi's method, which doubles the digits in each sweep once it is near, ends where this is left over the largest eigenvalue:
a millionth of what the weakest direction has."""


@borrowing
def rotate(matrix, vectors, i, j):
    """One of Jacobi's rotations: makes ``matrix[i, j]`` zero and turns the columns of ``vectors`` along."""
    if matrix[i, j] == 0.0:
        return
    ratio = 0.5 * (matrix[j, j] - matrix[i, i]) / matrix[i, j]
    tangent = math.copysign(1.0, ratio) / (abs(ratio) + math.sqrt(1.0 + ratio * ratio))
    c = 1.0 / math.sqrt(1.0 + tangent * tangent)
    s = c * tangent
    for k in range(3):
        a, b = matrix[k, i], matrix[k, j]
        matrix[k, i], matrix[k, j] = c * a - s * b, s * a + c * b
    for k in range(3):
        a, b = matrix[i, k], matrix[j, k]
        matrix[i, k], matrix[j, k] = c * a - s * b, s * a + c * b
    matrix[i, j], matrix[j, i] = 0.0, 0.0
    for k in range(3):
        a, b = vectors[k, i], vectors[k, j]
        vectors[k, i], vectors[k, j] = c * a - s * b, s * a + c * b


@borrowing
def eliminate(matrix, wanted):
    """Solve ``matrix x = wanted``, symmetric and positive, by elimination; and say whether no row nearly depends on others."""
    a, b, c = matrix[0, 0], matrix[0, 1], matrix[0, 2]
    least = SOUND * max(a, matrix[1, 1], matrix[2, 2])
    if not a > least:
        return 0.0, 0.0, 0.0, False
    p, q = b / a, c / a
    d, e, f = matrix[1, 1] - p * b, matrix[1, 2] - p * c, matrix[2, 2] - q * c
    if not d > least:
        return 0.0, 0.0, 0.0, False
    r = e / d
    f -= r * e
    if not f > least:
        return 0.0, 0.0, 0.0, False
    y = wanted[1] - p * wanted[0]
    z = (wanted[2] - q * wanted[0] - r * y) / f
    y = (y - e * z) / d
    return (wanted[0] - b * y - c * z) / a, y, z, True


@borrowing
def resolve(matrix, vectors, wanted):
    """The same in the sense of least squares, without the directions that are out of reach, by eigenvectors."""
    for i in range(3):
        for j in range(3):
            vectors[i, j] = 1.0 if i == j else 0.0
    for _ in range(SWEEPS):
        left = abs(matrix[0, 1]) + abs(matrix[0, 2]) + abs(matrix[1, 2])
        if left <= ROUNDING * max(matrix[0, 0], matrix[1, 1], matrix[2, 2]):
            break
        rotate(matrix, vectors, 0, 1)
        rotate(matrix, vectors, 0, 2)
        rotate(matrix, vectors, 1, 2)
    weakest = WEAKEST * max(matrix[0, 0], matrix[1, 1], matrix[2, 2])
    x, y, z = 0.0, 0.0, 0.0
    for i in range(3):
        if matrix[i, i] > weakest:
            a, b, c = vectors[0, i], vectors[1, i], vectors[2, i]
            share = (a * wanted[0] + b * wanted[1] + c * wanted[2]) / matrix[i, i]
            x, y, z = x + share * a, y + share * b, z + share * c
    return x, y, z


@borrowing
def least_norm(slope, n, wanted, matrix, vectors, step):
    """Shortest ``step`` whose ``slope step`` is nearest to ``wanted`` in the sense of least squares.

    Args:
        slope: (3, >= n). wanted: (3). matrix, vectors: (3, 3), overwritten. step: (>= n), its first ``n`` overwritten.
    """
    for i in range(3):
        for j in range(i + 1):
            total = 0.0
            for k in range(n):
                total += slope[i, k] * slope[j, k]
            matrix[i, j], matrix[j, i] = total, total
    x, y, z, sound = eliminate(matrix, wanted)
    if not sound:
        x, y, z = resolve(matrix, vectors, wanted)
    for k in range(n):
        step[k] = x * slope[0, k] + y * slope[1, k] + z * slope[2, k]
