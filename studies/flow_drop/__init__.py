"""What makes the mean flow fall above 30 Hz, and which measurement shows it?"""
