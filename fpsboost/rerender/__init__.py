"""Rendering of some frames and regions: a plan of what is worth rendering, and the merge of what was rendered.

`planning` finds the regions of interpolated frames that are most likely wrong, within a budget; `merging` puts them
back after they were rendered. `score` predicts the errors that a plan is based on, and `regions` turns them into
rectangles.

>>> import fpsboost
>>> plan = fpsboost.plan_rerender("renders/", "plan/", fpsboost.PlanOptions(budget=0.05))  # doctest: +SKIP
>>> # render the rectangles of plan/plan.json into regions/, then:
>>> fpsboost.merge_regions("doubled/", "regions/", "final/", fpsboost.MergeOptions("plan/"))  # doctest: +SKIP
"""
