"""What tables and pictures of reports show: who may do what, neighbours, certificates and dates."""
