# Formula of Homebrew for a tap of one's own: pip fetches the dependencies, which homebrew-core does not allow.
class Fpsboost < Formula
  desc "Raise the frame rate of videos and image sequences"
  homepage "{{ home }}"
  version "{{ version }}"
  license "BSD-3-Clause"
{%- for system, tags in [
  ("macos", {"arm": "macosx_11_0_arm64", "intel": "macosx_11_0_x86_64"}),
  ("linux", {"arm": "manylinux_2_17_aarch64", "intel": "manylinux_2_17_x86_64"}),
] %}

  on_{{ system }} do
{%- for processor, tag in tags.items() %}{% set wheel = "fpsboost-" ~ version ~ "-py3-none-" ~ tag ~ ".whl" %}
    on_{{ processor }} do
      url "{{ files }}/{{ wheel }}", using: :nounzip
      sha256 "{{ sha256[wheel] }}"
    end
{%- endfor %}
  end
{%- endfor %}

  depends_on "python@3.13"

  def install
    python = Formula["python@3.13"].opt_libexec/"bin/python"
    system python, "-m", "venv", libexec
    system libexec/"bin/python", "-m", "pip", "install", "#{Dir["*.whl"].first}[ui]"
    bin.install_symlink libexec/"bin/fpsboost"
  end

  test do
    system bin/"fpsboost", "doctor"
  end
end
