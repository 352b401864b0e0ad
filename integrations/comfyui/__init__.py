"""ComfyUI node that raises the frame rate of a batch of images with fpsboost.

The folder goes into ComfyUI's ``custom_nodes``; fpsboost itself is installed into ComfyUI's Python.
"""

from __future__ import annotations

from .node import FrameInterpolation

NODE_CLASS_MAPPINGS = {"FpsboostFrameInterpolation": FrameInterpolation}
NODE_DISPLAY_NAME_MAPPINGS = {"FpsboostFrameInterpolation": "Frame Interpolation (fpsboost)"}

__all__ = ["NODE_CLASS_MAPPINGS", "NODE_DISPLAY_NAME_MAPPINGS"]
