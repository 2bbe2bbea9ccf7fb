"""Experiments with the solver, which print and store their results: `python -m experiments run NAME`.

`verification` compares results with exact solutions and theory, and `validation` with measurements. Each of
the `studies` answers a question about devices, waves or slopes. `benchmarks` measure time and memory.
"""
