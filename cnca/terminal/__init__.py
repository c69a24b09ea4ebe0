"""What the commands say on the terminal; a module for each of ``cnca.cli``'s."""
