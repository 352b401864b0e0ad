"""Names of the package, beyond the public ones, that what is built upon it may use.

These are the user interface, plans and merges of renders, previews, and plugins of other programs: they import from
`fpsboost` and from here. ``extension.pyi`` beside this file lists the names; each is imported when it is asked for, so
that no program waits for libraries that it does not use.
"""

from lazy_loader import attach_stub

__getattr__, _, _ = attach_stub("fpsboost", __file__)
