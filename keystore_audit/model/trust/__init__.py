"""What evidence is worth to each implementation: who may sign, who vouches for whom, who is taken back."""
