"""Error against run time: qualities of solvers on one scene, against the Monte-Carlo reference solution."""
