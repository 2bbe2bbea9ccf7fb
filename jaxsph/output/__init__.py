"""Output files: runs and sweeps in HDF5, and exports for ParaView. Pictures are in `output.plot`."""
