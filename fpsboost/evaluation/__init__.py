"""How good a method is on anybody's own material: true frames are hidden, interpolated, and compared.

`compare` scores methods, `report` has the page of a comparison.
"""
