"""What is wrong with this recording?"""
