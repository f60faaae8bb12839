"""What policies, graphs and launch files mean, held against what permissions grant."""
