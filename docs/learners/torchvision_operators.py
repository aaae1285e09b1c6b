"""Names of torchvision's operators, for a CPU build of torch.

torchvision's wheel on PyPI is linked with CUDA. With a CPU build of torch its operators are missing, and its import fails for
two of them. LeRobot's data sets and state policies call none. ``make learners`` copies this file only if the import fails.
"""

import torch

NAMES = torch.library.Library("torchvision", "DEF")
NAMES.define("nms(Tensor dets, Tensor scores, float iou_threshold) -> Tensor")
NAMES.define("qnms(Tensor dets, Tensor scores, float iou_threshold) -> Tensor")
