"""Evaluation of methods on the user's own material: true frames are hidden, interpolated, and compared.

`hidden_frames` reads a clip and hides frames, `compared_methods` and `peers` interpolate them, `regions` finds the
areas where errors are expected, `results` and `further_metrics` score frames, `verdict` recommends a method, `export`
writes tables and data, and `report` writes the page. `compare` runs all of it:

>>> from fpsboost import methods
>>> from fpsboost.evaluation.compare import compare  # doctest: +SKIP
>>> from fpsboost.evaluation import ComparedInterpolator, HoldOut
>>> compared_methods = {name: ComparedInterpolator(methods[name]) for name in ("nlm", "blend")}
>>> comparison = compare("clip.mp4", compared_methods, HoldOut(skip=1), observer)  # doctest: +SKIP
>>> comparison.means(comparison.methods[0])["psnr"]  # doctest: +SKIP

The names that other packages use are listed in ``__init__.pyi`` and loaded at first use.
"""

import lazy_loader

# on first use, so that `fpsboost --help` does not wait for any of them
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
