#!/bin/sh
# Adds the app in this folder to the menu of the desktop, and to "Open with" of videos: a click opens its page, and clips
# that are opened with it, or dropped on it, are converted. Once on Linux, where file managers pass files to nothing else.
set -eu
folder=$(cd "$(dirname "$0")" && pwd)
case $folder in *[\"\`\$\\%]*) echo "The path $folder has a character that no menu can hold; move the folder." >&2; exit 1 ;; esac
menu=${XDG_DATA_HOME:-$HOME/.local/share}/applications
mkdir -p "$menu"
cat >"$menu/fpsboost.desktop" <<ENTRY
[Desktop Entry]
Type=Application
Name=fpsboost
Comment=Raise the frame rate of videos and image sequences
Exec=env FPSBOOST_KEEP_OPEN=1 "$folder/fpsboost" %F
Terminal=true
Categories=AudioVideo;
MimeType=video/mp4;video/quicktime;video/x-matroska;video/webm;image/gif;
ENTRY
echo "$menu/fpsboost.desktop"
