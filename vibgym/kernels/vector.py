"""Eight doubles as one value of a kernel: :data:`LANES` worlds side by side, a lane each.

Operators work lane by lane, and so do ``minimum``, ``maximum``, ``floor``, ``magnitude``, ``copysign`` and ``root``;
a number stands for itself in every lane, and ``spread(number)`` makes a value of it. Comparisons yield masks: ``&``, ``|`` and
``no`` combine them, ``select(mask, one, other)`` chooses by them, ``bits(mask)`` and ``mask_of(number)`` turn them into whole
numbers and back. ``load`` and ``store`` move values from and to flat arrays, ``load_mask`` and ``store_mask`` masks;
``least`` and ``greatest`` look across the lanes.

Kernels that use them are compiled by :func:`vibgym.kernels.jit.exact`. In plain mode there is one lane: the same kernels, with
numbers for values.
"""

from __future__ import annotations

from vibgym.kernels.options import PLAIN

if PLAIN:
    from vibgym.kernels import one_lane as _form
else:
    from vibgym.kernels import vec8 as _form

LANES: int = _form.LANES
WIDTH: int = _form.WIDTH
load, load_register, store = _form.load, _form.load_register, _form.store
load_mask, store_mask = _form.load_mask, _form.store_mask
spread, spread_register = _form.spread, _form.spread_register
bits, mask_of, mask_register, no, select = _form.bits, _form.mask_of, _form.mask_register, _form.no, _form.select
minimum, maximum, least, greatest = _form.minimum, _form.maximum, _form.least, _form.greatest
floor, magnitude, copysign, root = _form.floor, _form.magnitude, _form.copysign, _form.root
