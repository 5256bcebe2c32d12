"""hadr: depth restoration of hand-held transparent objects, as a small library.

The modules stand one concept each; import what you need, for example
``from hadr.camera import Intrinsics`` or ``from hadr.restoration import restore``.
"""

__version__ = "0.1.0"
