"""Problems to run: a model with its readings and results, and the source from which it can be rebuilt."""
