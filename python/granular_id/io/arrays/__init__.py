"""What named arrays hold: recordings, labels, sessions, rates; guessed, said, or refused."""
