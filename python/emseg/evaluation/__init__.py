"""Evaluation on data sets: segment, score by every protocol that the truth allows, report.

`segmented`: a recording with its labels.  `protocols`: the figures.  `published`: other people's.  `views`:
the best and worst windows.  `report`: tables, JSON, CSV, HTML.  `run`: all of it, as `emseg evaluate` does.
"""
