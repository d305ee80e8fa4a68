"""What every node needs: parameters, log, publishers, messages and their bytes."""
