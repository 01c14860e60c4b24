"""Error against run time: solvers over their quality ladders on one scene, against the Monte-Carlo referee."""
