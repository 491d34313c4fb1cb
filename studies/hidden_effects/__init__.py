"""How often is an effect that was hidden in a campaign found by the diagnosis?"""
