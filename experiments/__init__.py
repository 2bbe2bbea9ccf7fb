"""Runs that show what the solver does, each printing its numbers: `python -m experiments run NAME`.

`verification` compares with exact solutions and theory, `validation` with measurements; `studies` answer a
question about devices, waves or slopes; `benchmarks` measure time and memory.
"""
