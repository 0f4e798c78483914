"""``python -m tactemu``."""

from tactemu.cli import main

if __name__ == "__main__":
    main()
