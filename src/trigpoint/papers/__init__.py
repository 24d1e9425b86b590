"""Reproductions: each computes a paper's published numbers from its definitions, through public names only."""

from trigpoint.papers.base import Agreement, Cell, Field, Reproduction, Series
from trigpoint.papers.verb import EXPERIMENTS, reproduce

__all__ = ["EXPERIMENTS", "Agreement", "Cell", "Field", "Reproduction", "Series", "reproduce"]
