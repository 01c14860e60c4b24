"""Light along one line: optical depth, bent rays and the direct beam of the sun."""
