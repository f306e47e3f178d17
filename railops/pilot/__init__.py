"""The pilot vehicle: reference gap, tracking, and what it is worth in a mission.

Planning needs CasADi (``pip install 'railinspect[pilot]'``); everything else does not.
"""
