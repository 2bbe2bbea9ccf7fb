"""What is run, whoever made it: a model with its readings and results, and how it is made again."""
