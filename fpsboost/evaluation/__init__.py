"""How good a method is on anybody's own material: true frames are hidden, made again, and compared.

`compare` scores methods, `tune` sweeps the parameters of the report's, `report` makes a page of a comparison.
"""
