#!/bin/sh
# Certificates of your own authority: certificates.sh DIR NAME [ADDRESS]
#   certificates.sh tls router DNS:router.plant,IP:10.1.2.3    a router, with the names under which it is reached
#   certificates.sh tls monitor                                 a client: monitor, gateway, viewer
# makes DIR/NAME.pem and DIR/NAME.key, and DIR/ca.pem at the first call. DIR/ca.key signs: keep it off the machines.
set -eu
folder=${1:?a folder} name=${2:?a name} address=${3:-}
days=825
umask 077
mkdir -p "$folder"
cd "$folder"
if [ ! -e ca.key ]; then
  openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -days 3650 -subj "/CN=loopsight authority" \
    -addext basicConstraints=critical,CA:TRUE -addext keyUsage=critical,keyCertSign,cRLSign -keyout ca.key -out ca.pem
fi
openssl req -new -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -subj "/CN=$name" -keyout "$name.key" -out "$name.csr"
{
  echo "basicConstraints=critical,CA:FALSE"
  echo "extendedKeyUsage=serverAuth,clientAuth"
  echo "subjectAltName=${address:-DNS:$name}"
} > "$name.ext"
openssl x509 -req -in "$name.csr" -CA ca.pem -CAkey ca.key -CAcreateserial -days "$days" -extfile "$name.ext" -out "$name.pem"
rm "$name.csr" "$name.ext"
