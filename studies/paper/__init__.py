"""Which published results does the model reproduce, and what does each refinement of the model change?"""
