"""Which position controller tracks best, in continuous time and sampled?"""
