"""Files: runs and sweeps in HDF5, exports for ParaView; pictures are in `output.plot`."""
