"""torchvision from the package index has its C part for CUDA; beside a CPU build of PyTorch that does not load, and the
import of the rest asks for two operators of it. They are declared here, before torchvision is imported."""

import sys

OPERATORS = (
    "nms(Tensor dets, Tensor scores, float iou_threshold) -> Tensor",
    "qnms(Tensor dets, Tensor scores, float iou_threshold) -> Tensor",
)
LIBRARIES = []


class BeforeTorchvision:
    """Finds nothing; declares the operators when torchvision is looked for."""

    def find_spec(self, name, path=None, target=None):
        if name == "torchvision":
            sys.meta_path.remove(self)
            import torch

            library = torch.library.Library("torchvision", "DEF")
            for operator in OPERATORS:
                library.define(operator)
            LIBRARIES.append(library)
        return None


sys.meta_path.insert(0, BeforeTorchvision())
