"""Eight doubles as one value of a kernel: one part per lane.

- Operators, ``minimum``, ``maximum``, ``floor``, ``absolute``, ``copysign`` and ``sqrt`` work lane by lane. A number stands for
  itself in every lane; ``broadcast(number)`` makes a value of it.
- Comparisons return masks, which ``&``, ``|`` and ``logical_not`` combine. ``select(mask, one, other)`` takes lanes of ``one``
  where the mask holds. ``bits(mask)`` and ``mask_of(number)`` convert a mask to an integer and back: bit k is lane k.
- ``load`` and ``store`` read and write flat arrays, ``load_mask`` and ``store_mask`` arrays of bool.
- ``lane_minimum``, ``lane_maximum`` and ``lane_sum`` return the smallest lane, the largest one, and the sum of all.
- ``load_register``, ``broadcast_register`` and ``mask_register`` make values of ``WIDTH`` lanes, as many as a register holds.

Kernels that use these functions are compiled by :func:`vibgym.kernels.jit.exact`. Without compilation there is one lane, and
values are numbers.
"""

from __future__ import annotations

from vibgym.kernels.jit import INTERPRETED, MODE

if MODE == INTERPRETED:
    from vibgym.kernels import interpreted as _form
else:
    from vibgym.kernels import vec8 as _form

LANES: int = _form.LANES
WIDTH: int = _form.WIDTH
load, load_register, store = _form.load, _form.load_register, _form.store
load_mask, store_mask = _form.load_mask, _form.store_mask
broadcast, broadcast_register = _form.broadcast, _form.broadcast_register
bits, mask_of, mask_register, logical_not = _form.bits, _form.mask_of, _form.mask_register, _form.logical_not
select, minimum, maximum, copysign = _form.select, _form.minimum, _form.maximum, _form.copysign
lane_minimum, lane_maximum, lane_sum = _form.lane_minimum, _form.lane_maximum, _form.lane_sum
floor, absolute, sqrt = _form.floor, _form.absolute, _form.sqrt
