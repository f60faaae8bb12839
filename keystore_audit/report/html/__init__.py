"""The report as one web page that needs nothing but itself: no network, no script, no other file."""
