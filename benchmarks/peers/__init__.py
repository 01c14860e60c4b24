"""Side by side with other programs on exactly the same air; see benchmarks/peers_sasktran2.py."""
