"""Simulated recordings in the layouts of EV-IMO and EVIMO2.

Formats: https://better-flow.github.io/evimo/docs/ground-truth-format.html.  Depth is uint16 in mm, masks are
uint16 with a thousand times the object's number, 0 where there is neither.  Poses of objects are relative to the
camera, the camera's are relative to its first pose... see :func:`metadata`.
"""
