"""Frame-rate conversion by non-local means motion.

Levels of interface, each built on the one below:

- `convert` ``("in.mp4", "out.mp4", factor=2)``: files in, files out;
- `stream` ``(source, factor=2)``: from a path, a ``cv2.VideoCapture`` or arrays, to arrays as they are made;
- `interpolate_clip` ``(clip, fps=16, to_fps=60)``: the same over one array, such as a generated clip or a loop;
- `run_conversion` ``(source, interpolator, sink, schedule)``: the same over objects;
- `Interpolator.interpolate` ``(frame0, frame1, times)``, or `interpolate` for one image: arrays in, arrays out.
"""

import lazy_loader

__version__ = "0.1.0"

# on first use, so that `fpsboost --help` does not wait for OpenCV and FFmpeg
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
