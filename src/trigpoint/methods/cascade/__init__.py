"""The multi-tree cascade: a split of the plant's states by who sees what, and a tree of followers below each root."""
