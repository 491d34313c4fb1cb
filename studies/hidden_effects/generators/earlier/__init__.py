"""What the cases of the earlier judging set are made of: laws, small disturbances, sensor chains and benches.

They judged the method of commit a73dad3. Its wrong answers have been looked at since, so that the set is for
development now.
"""
