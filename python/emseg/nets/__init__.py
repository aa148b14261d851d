"""Networks that estimate depth and motion from slices of events, for comparison with the engine.

Nothing here is imported by `import emseg`; what needs PyTorch asks for it when it is imported.  The page
docs/networks.md says what there is, and where it comes from.
"""
