"""Benchmark: how often does the diagnosis find an effect that is hidden in a synthetic campaign?"""
