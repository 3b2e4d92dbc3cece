"""Concealed mismatches: a waveform- and ray-level generator with sealed answers, and the proof that is run on it.

Shares no module with the package (an import contract says so): what it makes is made by other means than the tool's.
"""
