"""Observers with the network's structure for agents that differ, in five steps that go from proved to searched."""

from trigpoint.methods.heterogeneous.method import STEPS, Heterogeneous

__all__ = ["STEPS", "Heterogeneous"]
