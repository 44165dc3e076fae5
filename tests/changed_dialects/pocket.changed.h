BEGIN PGM POCKET MM
; ph-post VERSION compensated this program
; ph-post: original sha256 666d68c644df8242718224a50d196f19dc5e3bd031f1f2a5561d44273f3b5012
; ph-post: machine stepper router, sha256 4c3cf1243d64a44b
; ph-post: options sha256 0000000000000000
; ph-post: dialect heidenhain
; ph-post: offset X 0.03 mm
; ph-post: offset Y 0.04 mm
; ph-post: take-up X 0.12 mm
; ph-post: take-up Y 0.16 mm
; ph-post: 2 stops, 0 dips
; ph-post: 15 crossings, up to 0.6829 mm long, within 0.002 mm
; ph-post: dwell 0 s, decimals 4, chord tolerance 0.001 mm, block time 5 ms
; ph-post: note holds for work offsets that are not rotated, mirrored or scaled
; ph-post: note holds where friction holds the axes against the cut
; without numbers, with a cycle, a label and a corrected contour
TOOL CALL "MILL_8" Z S5000
; ph-post: +3 -1 restart here, X approach, Y approach
L X-0.09 Y-0.12 R0 FMAX M3
L X+0.03 F232.3
L Y+0.04 F240
L Z+1 FMAX
L Z-1 F300
CC IX+6 IY+0
; ph-post: +67 -3 crossing Y-, crossing X-, crossing Y+, crossing X+
CC X+6.03 Y+0.04
C X+5.7344 Y+6.0327 DR- F800
L X+5.8867 Y+6.0402 F799.6
L X+5.95 Y+6.0324 F494.7
L X+6.0134 Y+6.0137 F510.4
L X+6.0707 Y+5.9868 F537.6
L X+6.122 Y+5.9699 F514.7
L X+6.1733 Y+5.9602 F499.2
L X+6.3256 Y+5.9527 F799.6
CC X+6.03 Y-0.04
C X+12.0227 Y+0.2556 DR- F800
L X+12.0301 Y+0.105 F799.6
L X+12.0246 Y+0.0388 F643.8
L X+12.0103 Y-0.0274 F655.3
L X+11.99 Y-0.0854 F676.1
L X+11.9775 Y-0.1352 F659.5
L X+11.9701 Y-0.185 F648.2
L X+11.9627 Y-0.3356 F799.6
CC X+5.97 Y-0.04
C X+6.2656 Y-6.0327 DR- F800
L X+6.1133 Y-6.0402 F799.6
L X+6.05 Y-6.0324 F494.7
L X+5.9866 Y-6.0137 F510.4
L X+5.9293 Y-5.9868 F537.6
L X+5.878 Y-5.9699 F514.7
L X+5.8267 Y-5.9602 F499.2
L X+5.6744 Y-5.9527 F799.6
CC X+5.97 Y+0.04
C X-0.03 Y+0.04 DR- F800
L Y-0.04 F240
CR X-2.0227 Y-4.9902 R+8 DR+ F800
L X-2.0301 Y-5.1641 F799.6
L X-2.0246 Y-5.2405 F742.8
L X-2.0103 Y-5.3169 F752.8
L X-1.99 Y-5.3839 F771.1
L X-1.9775 Y-5.4414 F756.5
L X-1.9701 Y-5.4989 F746.6
L X-1.9627 Y-5.6728 F799.6
CR X+5.6887 Y-13.3242 R+8 DR+ F800
L X+5.8645 Y-13.3317 F799.6
L X+5.9377 Y-13.3239 F570.3
L X+6.0108 Y-13.3052 F583.9
L X+6.077 Y-13.2783 F607.9
L X+6.1362 Y-13.2614 F587.7
L X+6.1955 Y-13.2517 F574.2
L X+6.3713 Y-13.2442 F799.6
CR X+14.0227 Y-5.5928 R+8 DR+ F800
L X+14.0301 Y-5.4189 F799.6
L X+14.0246 Y-5.3425 F742.8
L X+14.0103 Y-5.2661 F752.8
L X+13.99 Y-5.1991 F771.1
L X+13.9775 Y-5.1416 F756.5
L X+13.9701 Y-5.0841 F746.6
L X+13.9627 Y-4.9102 F799.6
CR X+11.97 Y+0.04 R+8 DR+ F800
CR X+6.3113 Y+2.7412 R+8 DR+
L X+6.1355 Y+2.7487 F799.6
L X+6.0623 Y+2.7409 F570.3
L X+5.9892 Y+2.7222 F583.9
L X+5.923 Y+2.6953 F607.9
L X+5.8638 Y+2.6784 F587.7
L X+5.8045 Y+2.6687 F574.2
L X+5.6287 Y+2.6612 F799.6
CR X-0.03 Y-0.04 R+8 DR+ F800
L X+0.03 Y+0.04 F300
CC X+6 Y+0
L F800
L X+20.03 Y+3.04 M8
; ph-post: +2 -0 crossing X-, crossing Y-
L X+19.97 Y+2.96 F300
L F800
L X-4.03
; ph-post: +2 -0 crossing X+
L X-3.97 F232.3
L F800
CYCL DEF 9.0 DWELL TIME
CYCL DEF 9.1 DWELL 0.5
L X+6.03 Y-7.04
; ph-post: +2 -0 crossing X-, crossing Y+
L X+5.97 Y-6.96 F300
L F800
L IX-6 IY+7
L Z+5 FMAX
; ph-post: +3 -0 X to 0, Y to 0
L X+0 F116.1
L Y+0 F120
L F800
CYCL DEF 200 DRILLING ~
  Q200=2 ~
  Q201=-10
L X+5 Y+5 FMAX M99
L X+40 Y+0 R0 FMAX
L Z+1 FMAX
L X+30 Y+0 RL F500
L X+30 Y+20
L X+40 Y+20 R0
L Z+5 FMAX
L X+60 Y+0 FMAX
LBL 1
L X+70 FMAX
CALL LBL 1 REP2
M30
; ph-post: undo 1/2 …
; ph-post: undo 2/2 …
END PGM POCKET MM
