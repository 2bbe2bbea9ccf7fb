"""Pair sums as native code: pair laws, compiled by LLVM for the processor at hand."""
