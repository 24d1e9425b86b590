"""Linear algebra without graph or control words: blocks, sparse solvers, spectra, equations, verified bounds."""
