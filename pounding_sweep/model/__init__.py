"""The row of buildings, its contact laws and the rebound that they give."""
