#!/bin/sh
# Write src/posefuse/report/assets/three.min.js: the classes of three.js that solids.js uses, in one file.
# Needs npm. After another version or another class, run it again and commit the file.
set -eu
version=0.187.0
assets=$(cd "$(dirname "$0")/../src/posefuse/report/assets" && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
npm install --silent --no-save "three@$version" esbuild@0.28.2
classes=$(grep -o 'THREE\.[A-Za-z0-9]*' "$assets/solids.js" | sed 's/THREE\.//' | sort -u | paste -sd, -)
echo "export { $classes } from 'three';" >entry.js
npx esbuild entry.js --bundle --minify --format=iife --global-name=THREE --legal-comments=none \
    --banner:js="/* three.js $version, Copyright 2010-2026 three.js authors, MIT license */" \
    --outfile="$assets/three.min.js"
cp node_modules/three/LICENSE "$assets/three.LICENSE"
