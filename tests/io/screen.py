# A terminal (pyte) for tests: reads lines from stdin and acts on them, the screen goes to stdout.
#   size COLUMNS ROWS    opens the terminal, or resizes it
#   feed HEX             bytes that a program wrote
#   show                 prints the rows of the screen without what is empty at their ends and below them, then
#                        "cursor COLUMN ROW" (from 0)
#   colors               prints the foreground colours on the screen
import sys

import pyte

screen = stream = None
for line in sys.stdin:
    command, *words = line.split()
    if command == "size":
        columns, rows = map(int, words)
        if screen:
            screen.resize(rows, columns)
        else:
            screen = pyte.Screen(columns, rows)
            screen.set_mode(pyte.modes.LNM)  # as a terminal driver turns a newline into two characters
            stream = pyte.ByteStream(screen)
    elif command == "feed":
        stream.feed(bytes.fromhex(words[0]))
    elif command == "show":
        print("\n".join(row.rstrip() for row in screen.display).rstrip("\n"))
        print("cursor", screen.cursor.x, screen.cursor.y)
    elif command == "colors":
        cells = [cell for row in screen.buffer.values() for cell in row.values()]
        print(" ".join(sorted({cell.fg for cell in cells})))
    else:
        sys.exit(f"unknown command: {command}")
